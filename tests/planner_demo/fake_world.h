// A world known in closed form, for tests of the planner.
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "planner_demo/plan/clearance_probe.h"

namespace clearance::demo {

// A ball (object 1, 2, ..) that moves at constant velocity; static ones are walls at x = wall_x_m.
struct MovingBall {
  Eigen::Vector3d at_W;  // at time 0
  Eigen::Vector3d velocity_mps;
  double radius_m;
};

struct FakeWorld {
  std::vector<MovingBall> balls;
  double wall_x_m = 1e3;  // everything beyond is solid

  double Distance(const Eigen::Vector3d& p_W, double time_s, uint32_t* object) const {
    double nearest_m = wall_x_m - p_W.x();
    *object = 0;
    for (size_t i = 0; i < balls.size(); ++i) {
      const double d =
          (p_W - balls[i].at_W - time_s * balls[i].velocity_mps).norm() - balls[i].radius_m;
      if (d < nearest_m) {
        nearest_m = d;
        *object = static_cast<uint32_t>(i + 1);
      }
    }
    return nearest_m;
  }

  // Answers like a map whose newest frame is of time `stamp_s`.
  Lookup LookupAt(double stamp_s) const {
    return [this, stamp_s](
               const Eigen::Matrix3Xd& points_W,
               const std::vector<float>& horizons_s) -> absl::StatusOr<client::DistanceAnswers> {
      client::DistanceAnswers answers;
      for (Eigen::Index i = 0; i < points_W.cols(); ++i) {
        uint32_t object = 0;
        answers.distances_m.push_back(
            static_cast<float>(Distance(points_W.col(i), stamp_s + horizons_s[i], &object)));
        answers.object_ids.push_back(object);
        answers.states.push_back(static_cast<uint8_t>(client::SpaceState::kFree));
      }
      return answers;
    };
  }
};

// A sphere of 0.5 m.
inline RobotModel Ball() {
  RobotModel robot = DeliveryRobot();
  robot.spheres = {{Eigen::Vector3d::Zero(), 0.5}};
  return robot;
}

}  // namespace clearance::demo
