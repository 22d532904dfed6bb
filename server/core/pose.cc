#include "server/core/pose.h"

#include <Eigen/SVD>
#include <cmath>

namespace clearance {
namespace {

Eigen::Matrix3d Skew(const Eigen::Vector3d& w) {
  Eigen::Matrix3d s;
  s << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return s;
}

// Below this angle the closed forms of sin(x)/x and its relatives lose digits to cancellation.
constexpr double kSmallAngle_rad = 1e-4;

}  // namespace

Pose Orthonormalized(const Pose& T) {
  Pose out = Pose::Identity();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(T.linear(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  out.linear() = svd.matrixU() * svd.matrixV().transpose();
  out.translation() = T.translation();
  return out;
}

Pose ExpScrew(const Screw& xi) {
  const Eigen::Vector3d v = xi.head<3>(), w = xi.tail<3>();
  const double a2 = w.squaredNorm(), a = std::sqrt(a2);
  double s, c, d;  // sin(a)/a, (1 - cos a)/a^2, (a - sin a)/a^3
  if (a < kSmallAngle_rad) {
    s = 1 - a2 / 6, c = 0.5 - a2 / 24, d = 1.0 / 6 - a2 / 120;
  } else {
    s = std::sin(a) / a, c = (1 - std::cos(a)) / a2, d = (1 - s) / a2;
  }
  const Eigen::Matrix3d W = Skew(w), W2 = W * W;
  Pose T = Pose::Identity();
  T.linear() = Eigen::Matrix3d::Identity() + s * W + c * W2;
  T.translation() = v + c * (W * v) + d * (W2 * v);
  return T;
}

Screw LogScrew(const Pose& T) {
  Eigen::Quaterniond q(T.linear());
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double n = q.vec().norm();
  const double a = 2 * std::atan2(n, q.w());
  const Eigen::Vector3d w = (n < 1e-12 ? 2.0 : a / n) * q.vec();
  const double a2 = a * a;
  // V^-1 = I - W/2 + k W^2 with k = (1 - (a/2) cot(a/2)) / a^2.
  const double k =
      a < kSmallAngle_rad ? 1.0 / 12 + a2 / 720 : (1 - 0.5 * a / std::tan(0.5 * a)) / a2;
  const Eigen::Matrix3d W = Skew(w);
  Screw xi;
  xi.head<3>() = T.translation() - 0.5 * (W * T.translation()) + k * (W * (W * T.translation()));
  xi.tail<3>() = w;
  return xi;
}

Pose ExtrapolateMotion(const Pose& H_W, double period_s, double s) {
  return ExpScrew(LogScrew(H_W) * (s / period_s));
}

Twist TwistOfMotion(const Pose& H_W, double period_s, const Pose& T_W_L) {
  const Screw xi = LogScrew(H_W) / period_s;
  // The screw's first part is the velocity of the world's origin; move it to the body's.
  return {xi.head<3>() + xi.tail<3>().cross(T_W_L.translation()), xi.tail<3>()};
}

}  // namespace clearance
