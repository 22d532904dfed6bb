// The normal of a few points.
#pragma once

#include <Eigen/Core>

namespace clearance {

// Unit direction in which `count` points spread least, each weighted by 1 / noise_variance. Where
// points do not span a plane: the direction nearest to `fallback` (unit) that is normal to their
// line, or `fallback` itself.
Eigen::Vector3f SmallestAxis(const Eigen::Vector3f* points, const float* noise_variance, int count,
                             const Eigen::Vector3f& fallback);

}  // namespace clearance
