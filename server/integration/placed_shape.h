// What an object's submap says about a place of the world, were the object at a given pose.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "absl/container/flat_hash_map.h"
#include "server/core/aabb.h"
#include "server/core/pose.h"
#include "server/integration/stored_surface.h"
#include "server/map/surface_map.h"

namespace clearance {

// Not thread-safe, cheap to copy; the submap must outlive it and stand still.
class PlacedShape {
 public:
  PlacedShape(const SurfaceMap& surface, const Pose& T_W_L);

  // Of the blocks that hold the submap's band; in L.
  const Aabb& box_L() const { return box_L_; }
  const Pose& T_W_L() const { return T_W_L_; }
  PlacedShape MovedTo(const Pose& T_W_L) const;
  // Around the box, in W.
  Aabb box_W() const;

  // The submap's signed distance at p_W; absent outside its band, and where it surely differs from
  // `about_m` by more than `within_m`.
  struct Value {
    double distance_m = 0;
    Eigen::Vector3f normal_W = Eigen::Vector3f::Zero();  // zero where the neighbours do not tell
  };
  std::optional<Value> At(const Eigen::Vector3d& p_W, double about_m, double within_m) const;

 private:
  double h_;
  std::shared_ptr<const absl::flat_hash_map<BlockIndex, StoredSurface>> blocks_;
  Pose T_W_L_, T_L_W_;
  Aabb box_L_;
};

}  // namespace clearance
