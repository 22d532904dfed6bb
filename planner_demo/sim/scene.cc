#include "planner_demo/sim/scene.h"

namespace clearance::sim {

double TrueDistance(const Scene& scene, const Eigen::Vector3d& point_W, double time_s, int* mover) {
  double nearest_m = SignedDistance(scene.static_solids, point_W);
  int decides = -1;
  for (size_t i = 0; i < scene.movers.size(); ++i) {
    const Mover& m = scene.movers[i];
    const double distance_m = SignedDistance(m.solids, m.T_W_L(time_s).inverse() * point_W);
    if (distance_m < nearest_m) {
      nearest_m = distance_m;
      decides = static_cast<int>(i);
    }
  }
  if (mover != nullptr) *mover = decides;
  return nearest_m;
}

}  // namespace clearance::sim
