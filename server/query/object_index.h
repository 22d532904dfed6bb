// Where the objects of a view are, now and later: bounds that let a query skip most of them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "server/map/map_view.h"
#include "server/query/eight_way.h"

namespace clearance {

// A bounding-volume tree over the objects' boxes whose bounds hold at every horizon s >= 0: a box
// is [lower + s * v_lower - s^2 a / 2, upper + s * v_upper + s^2 a / 2], since a body on a constant
// screw deviates from its first velocity by at most a s^2 / 2. Immutable once built.
struct ObjectIndex {
  // One object that counts (not RETIRED, with surface).
  struct Entry {
    Eigen::Matrix3d R_L_W;  // of T_L_W at the view's stamp
    Eigen::Vector3d t_W_L;  // L's origin in W
    Screw screw_W;
    Eigen::AlignedBox3f bounds_L;  // of the shape's surfels
    float position_sigma_m = 0, velocity_sigma_mps = 0;
    float max_site_sigma_m = 0;  // largest sigma of the shape's sites
    uint32_t object = 0;         // index in the view's objects
    ObjectId id;
    LifeState life_state = LifeState::kTracked;
    std::shared_ptr<const ObjectShape> shape;
  };
  // Boxes of up to eight children, relative to origin_W; empty lanes are kFarAway. A child is a
  // node, or with kEntry set an entry.
  static constexpr uint32_t kEntry = 0x80000000u;
  struct alignas(32) Node {
    float lower[3][kWays], upper[3][kWays];      // metres, at s = 0
    float v_lower[3][kWays], v_upper[3][kWays];  // m/s
    float acceleration_mps2[kWays];              // a above
    // No answer below has a sigma above sigma_m + s * sigma_growth_mps.
    float sigma_m[kWays], sigma_growth_mps[kWays];
    uint32_t child[kWays];
  };

  Eigen::Vector3d origin_W = Eigen::Vector3d::Zero();
  std::vector<Entry> entries;  // in tree order
  std::vector<Node> nodes;     // root first; empty without entries
  float slack_m = 0;  // how far rounding may move a bound, for a point at origin_W at s = 0
};

// Index of the objects of one view. O(n log n), about half a microsecond an object.
std::shared_ptr<const ObjectIndex> BuildObjectIndex(const std::vector<ObjectView>& objects);

}  // namespace clearance
