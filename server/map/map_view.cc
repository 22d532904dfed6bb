#include "server/map/map_view.h"

namespace clearance {

OrientedBox ObjectView::Box() const {
  OrientedBox box;
  box.world_from_box = T_W_L;
  if (!shape || shape->bounds_L.isEmpty())
    return box;  // no surface yet: a point at the object's origin
  box.world_from_box.translation() = T_W_L * shape->bounds_L.center().cast<double>();
  box.size_m = shape->bounds_L.sizes().cast<double>();
  return box;
}

}  // namespace clearance
