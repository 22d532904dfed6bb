// Rigid poses and screw motions. T_A_B maps coordinates in B to A: p_A = T_A_B * p_B.
#pragma once

#include <Eigen/Geometry>

namespace clearance {

using Pose = Eigen::Isometry3d;

// T with the nearest rotation (polar decomposition) as its linear part: chained products drift away
// from SO(3) by rounding, and this brings them back without moving the origin.
Pose Orthonormalized(const Pose& T);

// Velocity of a rigid body, both parts expressed in W: `linear_mps` of its origin, `angular_radps`
// about its origin.
struct Twist {
  Eigen::Vector3d linear_mps = Eigen::Vector3d::Zero();
  Eigen::Vector3d angular_radps = Eigen::Vector3d::Zero();
};

// SE(3) exponential and logarithm, [v; w] with v the translational part (metres) and w the rotation
// vector (rad), |w| < pi for the logarithm.
using Screw = Eigen::Matrix<double, 6, 1>;
Pose ExpScrew(const Screw& xi);
Screw LogScrew(const Pose& T);

// The world motion H_W(s) that a body following constant screw `H_W` (over `period_s`) makes in
// `s` seconds: exp(s / period_s * log H_W). L(t + s) = H_W(s) * L(t).
Pose ExtrapolateMotion(const Pose& H_W, double period_s, double s);

// Twist of a body at T_W_L that makes the world motion `H_W` in `period_s`.
Twist TwistOfMotion(const Pose& H_W, double period_s, const Pose& T_W_L);

}  // namespace clearance
