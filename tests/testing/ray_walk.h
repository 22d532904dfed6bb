// The oracle of free space: every ray, voxel by voxel, in double.
#pragma once

#include <cmath>

#include "server/core/frame.h"
#include "server/map/voxel.h"

namespace clearance::testing {

// Calls visit(voxel, enter_m, leave_m) for every voxel that the segment from `eye_W` to `end_W`
// passes through and leaves, in order; the voxel that holds `end_W` is not visited.
template <typename Visit>
void WalkRay(const Eigen::Vector3d& eye_W, const Eigen::Vector3d& end_W, double h,
             const Visit& visit) {
  const double length = (end_W - eye_W).norm();
  if (!(length > 0)) return;
  const Eigen::Vector3d direction = (end_W - eye_W) / length;
  VoxelIndex at = VoxelOf(eye_W, h);
  const VoxelIndex last = VoxelOf(end_W, h);
  Eigen::Vector3d next, delta;
  for (int a = 0; a < 3; ++a) {
    const double d = direction[a];
    const double wall = (at[a] + (d > 0 ? 1 : 0)) * h;
    next[a] = d != 0 ? (wall - eye_W[a]) / d : INFINITY;
    delta[a] = d != 0 ? h / std::abs(d) : INFINITY;
  }
  for (double enter = 0; at != last;) {
    int axis = 0;
    next.minCoeff(&axis);
    if (next[axis] > length) return;
    visit(at, enter, next[axis]);
    enter = next[axis];
    at[axis] += direction[axis] > 0 ? 1 : -1;
    next[axis] += delta[axis];
  }
}

// Calls ray(point_X, label) for every return of the frame, nearer than max_range_m or not.
template <typename Ray>
void ForEachReturn(const Frame& frame, const Ray& ray) {
  if (const auto* depth = std::get_if<DepthImage>(&frame.observation)) {
    for (uint32_t v = 0; v < depth->height; ++v) {
      for (uint32_t u = 0; u < depth->width; ++u) {
        const size_t i = size_t{v} * depth->width + u;
        if (depth->depth[i] == 0) continue;
        const double z = depth->depth[i] * depth->depth_scale_m;
        ray(Eigen::Vector3d(z * (u - depth->cx) / depth->fx, z * (v - depth->cy) / depth->fy, z),
            depth->labels.empty() ? uint16_t{0} : depth->labels[i]);
      }
    }
  } else if (const auto* cloud = std::get_if<PointCloud>(&frame.observation)) {
    for (Eigen::Index i = 0; i < cloud->points_X.cols(); ++i) {
      if (cloud->points_X.col(i).isZero(0)) continue;
      ray(Eigen::Vector3d(cloud->points_X.col(i).cast<double>()),
          cloud->labels.empty() ? uint16_t{0} : cloud->labels[i]);
    }
  }
}

}  // namespace clearance::testing
