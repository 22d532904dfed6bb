#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <limits>
#include <vector>

#include "planner_demo/sim/solid.h"

namespace clearance::sim {

// Finds the first surface along rays through solids that stand still, by a tree of boxes.
// Immutable after Build, so Cast may be called from several threads.
class RayCaster {
 public:
  struct Hit {
    // First crossing as the parameter t > 0 of origin + t * direction; infinity: none.
    double t = std::numeric_limits<double>::infinity();
    uint16_t owner = 0;
    int solid = -1;  // for the next ray's `hint`
  };

  // Adds solids of the body at T_W_B; hits on them carry `owner`.
  void Add(const std::vector<Solid>& solids, const Eigen::Isometry3d& T_W_B, uint16_t owner);
  void Build();

  // Hits beyond max_t are not reported. `hint` is a solid likely to be hit (that of a neighbouring
  // ray) or -1; it changes the time taken, never the result.
  Hit Cast(const Eigen::Vector3d& origin_W, const Eigen::Vector3d& direction_W, double max_t,
           int hint = -1) const;

 private:
  struct Placed {
    Shape shape;
    Eigen::Isometry3d T_S_W;
    Eigen::AlignedBox3d bounds_W;
    uint16_t owner;
  };
  struct Node {
    Eigen::AlignedBox3d bounds_W;
    int first;  // leaf: first entry of order_; inner: index of the right child (left one: this + 1)
    int count;  // 0: inner node
    int axis;
  };

  int BuildNode(int begin, int end);
  void Test(int solid, const Eigen::Vector3d& origin_W, const Eigen::Vector3d& direction_W,
            Hit& best) const;

  std::vector<Placed> solids_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
};

}  // namespace clearance::sim
