// Boxes: axis-aligned and oriented.
#pragma once

#include <Eigen/Geometry>

#include "server/core/pose.h"

namespace clearance {

using Aabb = Eigen::AlignedBox3d;

// A box with its centre pose in the world and its full side lengths.
struct OrientedBox {
  Pose world_from_box = Pose::Identity();
  Eigen::Vector3d size_m = Eigen::Vector3d::Zero();
};

}  // namespace clearance
