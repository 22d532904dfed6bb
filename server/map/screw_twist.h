// Velocity of a body on a constant screw.
#pragma once

#include "server/core/pose.h"

namespace clearance {

// Of a body at `T_W_L` whose screw in W is [v; w] a second: v + w x p at its origin.
inline Twist TwistOfScrew(const Screw& screw_W, const Pose& T_W_L) {
  Twist twist;
  twist.angular_radps = screw_W.tail<3>();
  twist.linear_mps =
      screw_W.head<3>() + twist.angular_radps.cross(Eigen::Vector3d(T_W_L.translation()));
  return twist;
}

}  // namespace clearance
