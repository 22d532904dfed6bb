// What the demo drives or flies, and where it is.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace clearance::demo {

struct RobotSphere {
  Eigen::Vector3d center_R;  // in the robot's frame, which never rolls or pitches
  double radius_m;
};

// Moves along its heading, turns on circles of at least turn_radius_m, and about itself at rest.
struct RobotModel {
  std::vector<RobotSphere> spheres;
  double max_speed_mps = 4.0;
  double max_accel_mps2 = 2.0;
  double max_brake_mps2 = 4.0;
  double turn_radius_m = 1.0;
  double turn_rate_radps = 2.0;  // about itself, at rest
  double max_climb = 0.0;        // metres up or down a metre along the ground; 0: it drives
};

// An upright robot of 0.9 by 1.6 m on wheels large enough for a kerb.
inline RobotModel DeliveryRobot() {
  return {{{{0.0, 0.0, 0.7}, 0.45}, {{0.0, 0.0, 1.5}, 0.35}}, 4.0, 2.0, 4.0, 1.0, 2.0, 0.0};
}
// Its origin is its centre.
inline RobotModel Drone() { return {{{{0.0, 0.0, 0.0}, 0.4}}, 4.0, 2.5, 4.0, 1.0, 2.0, 0.7}; }

struct RobotState {
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  double heading_rad = 0.0;
  double speed_mps = 0.0;  // along the heading, >= 0
  double time_s = 0.0;     // on the frames' clock
};

}  // namespace clearance::demo
