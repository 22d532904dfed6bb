#pragma once

#include <Eigen/Core>

namespace clearance::sim {

// Distance in metres from p to the triangle a, b, c.
double DistanceToTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                          const Eigen::Vector3d& b, const Eigen::Vector3d& c);

}  // namespace clearance::sim
