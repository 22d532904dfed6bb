#include "planner_demo/sim/triangle.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace clearance::sim {
namespace {

double DistanceToSegment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                         const Eigen::Vector3d& b) {
  const Eigen::Vector3d along = b - a;
  const double length2 = along.squaredNorm();
  const double t = length2 > 0.0 ? std::clamp((p - a).dot(along) / length2, 0.0, 1.0) : 0.0;
  return (p - a - t * along).norm();
}

}  // namespace

double DistanceToTriangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                          const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const bool over = (b - a).cross(p - a).dot(normal) >= 0.0 &&
                    (c - b).cross(p - b).dot(normal) >= 0.0 &&
                    (a - c).cross(p - c).dot(normal) >= 0.0;
  if (over && normal.squaredNorm() > 0.0) return std::abs((p - a).dot(normal)) / normal.norm();
  return std::min(
      {DistanceToSegment(p, a, b), DistanceToSegment(p, b, c), DistanceToSegment(p, c, a)});
}

}  // namespace clearance::sim
