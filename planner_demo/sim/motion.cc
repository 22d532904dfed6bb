#include "planner_demo/sim/motion.h"

#include <algorithm>
#include <cmath>

namespace clearance::sim {

double Path::ArcLengthAt(double time_s) const {
  double arc_length_m = start_offset_m;
  if (speeds.empty()) return arc_length_m;
  const auto speed_at = [this](double t) {
    if (t <= speeds.front().time_s) return speeds.front().speed_mps;
    for (size_t i = 1; i < speeds.size(); ++i) {
      const SpeedKnot& a = speeds[i - 1];
      const SpeedKnot& b = speeds[i];
      if (t < b.time_s) {
        return a.speed_mps + (b.speed_mps - a.speed_mps) * (t - a.time_s) / (b.time_s - a.time_s);
      }
    }
    return speeds.back().speed_mps;
  };
  // Speed is linear between knots, so the trapezoid over each stretch of time is exact.
  double from = 0.0;
  const double sign = time_s >= 0.0 ? 1.0 : -1.0;
  std::vector<double> stops;
  for (const SpeedKnot& knot : speeds) {
    if (knot.time_s * sign > 0.0 && knot.time_s * sign < time_s * sign)
      stops.push_back(knot.time_s);
  }
  std::sort(stops.begin(), stops.end(), [sign](double a, double b) { return a * sign < b * sign; });
  stops.push_back(time_s);
  for (const double to : stops) {
    arc_length_m += 0.5 * (speed_at(from) + speed_at(to)) * (to - from);
    from = to;
  }
  return arc_length_m;
}

Eigen::Isometry3d Path::PoseAtArcLength(double arc_length_m) const {
  Eigen::Vector3d position_W = start_W;
  double heading_rad = start_heading_rad;
  const auto advance = [&](double length_m, double curvature_radpm) {
    if (curvature_radpm == 0.0) {
      position_W += length_m * Eigen::Vector3d(std::cos(heading_rad), std::sin(heading_rad), 0.0);
      return;
    }
    const double turned = heading_rad + length_m * curvature_radpm;
    position_W += Eigen::Vector3d(std::sin(turned) - std::sin(heading_rad),
                                  std::cos(heading_rad) - std::cos(turned), 0.0) /
                  curvature_radpm;
    heading_rad = turned;
  };
  double left_m = arc_length_m;
  if (left_m > 0.0) {
    for (const Stretch& stretch : stretches) {
      const double length_m = std::min(left_m, stretch.length_m);
      advance(length_m, stretch.curvature_radpm);
      left_m -= length_m;
      if (left_m <= 0.0) break;
    }
  }
  if (left_m != 0.0) advance(left_m, 0.0);
  return Upright(position_W, heading_rad);
}

Eigen::Isometry3d Upright(const Eigen::Vector3d& position_W, double yaw_rad) {
  Eigen::Isometry3d T_W_B = Eigen::Isometry3d::Identity();
  T_W_B.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T_W_B.translation() = position_W;
  return T_W_B;
}

Eigen::Isometry3d LookAt(const Eigen::Vector3d& eye_W, const Eigen::Vector3d& target_W) {
  const Eigen::Vector3d forward = (target_W - eye_W).normalized();
  const Eigen::Vector3d right = forward.cross(Eigen::Vector3d::UnitZ()).normalized();
  Eigen::Isometry3d T_W_X = Eigen::Isometry3d::Identity();
  T_W_X.linear() << right, forward.cross(right), forward;
  T_W_X.translation() = eye_W;
  return T_W_X;
}

}  // namespace clearance::sim
