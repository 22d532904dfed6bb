#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "planner_demo/sim/solid.h"

namespace clearance::sim {

// Triangles counter-clockwise seen from outside; vertices in metres.
struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<int, 3>> faces;
};

// Closed surfaces of the solids in the frame of their body. Curved surfaces are split so finely
// that no triangle is further than `tolerance_m` from them. Overlapping solids stay separate closed
// surfaces, so faces can be buried in a neighbour.
TriangleMesh Triangulate(const std::vector<Solid>& solids, double tolerance_m = 2e-4);

}  // namespace clearance::sim
