#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <vector>

namespace clearance::sim {

// A scripted pose T_W_B at any time in seconds, before, during and after a recording.
using PoseFunction = std::function<Eigen::Isometry3d(double time_s)>;

// A planar path: straight stretches and arcs, travelled with a scripted speed.
struct Path {
  struct Stretch {
    double length_m;
    double curvature_radpm;  // > 0: to the left
  };
  struct SpeedKnot {  // speed is linear between knots and constant outside of them
    double time_s;
    double speed_mps;  // >= 0
  };

  Eigen::Vector3d start_W = Eigen::Vector3d::Zero();
  double start_heading_rad = 0.0;
  std::vector<Stretch> stretches;  // after the last one, straight on
  std::vector<SpeedKnot> speeds;   // times rise
  double start_offset_m = 0.0;     // arc length at time 0; may be negative (before the start)

  double ArcLengthAt(double time_s) const;
  // x forward along the path, z up.
  Eigen::Isometry3d PoseAtArcLength(double arc_length_m) const;
  Eigen::Isometry3d PoseAt(double time_s) const { return PoseAtArcLength(ArcLengthAt(time_s)); }
};

// Pose at `position_W` turned by yaw about z.
Eigen::Isometry3d Upright(const Eigen::Vector3d& position_W, double yaw_rad);

// Pose T_W_X of a camera (x right, y down, z forward) at `eye_W` that looks at `target_W`.
Eigen::Isometry3d LookAt(const Eigen::Vector3d& eye_W, const Eigen::Vector3d& target_W);

}  // namespace clearance::sim
