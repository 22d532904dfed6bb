#include "planner_demo/episode/judge.h"

#include <algorithm>
#include <cmath>

namespace clearance::demo {
namespace {

constexpr double kAtRest_mps = 0.05;
constexpr double kLongEnough_s = 1.0;
constexpr double kClosing_mps = 20.0;
constexpr double kShortest_s = 1e-3;
constexpr double kLongest_s = 0.02;

}  // namespace

Judge::Judge(const Truth& truth, const RobotModel& robot, const Mission& mission)
    : truth_(truth), robot_(robot), mission_(mission) {}

double Judge::Clearance(const RobotState& state, uint16_t* object_id) const {
  double least_m = INFINITY;
  const double cos = std::cos(state.heading_rad), sin = std::sin(state.heading_rad);
  for (const RobotSphere& sphere : robot_.spheres) {
    const Eigen::Vector3d& c = sphere.center_R;
    const Eigen::Vector3d center_W =
        state.position_W +
        Eigen::Vector3d(cos * c.x() - sin * c.y(), sin * c.x() + cos * c.y(), c.z());
    uint16_t nearest = 0;
    const double gap_m = truth_.Distance(center_W, state.time_s, &nearest) - sphere.radius_m;
    if (gap_m < least_m) {
      least_m = gap_m;
      *object_id = nearest;
    }
  }
  return least_m;
}

void Judge::Advance(const std::function<RobotState(double)>& drive, double from_s, double to_s) {
  double t = from_s;
  while (t < to_s && !verdict_.collision) {
    const RobotState state = drive(t);
    const bool rests = state.speed_mps < kAtRest_mps;
    if (!rests) {
      stands_since_s_.reset();
    } else if (!stands_since_s_) {
      stands_since_s_ = t;
    }
    uint16_t object_id = 0;
    const double clearance_m = Clearance(state, &object_id);
    if (clearance_m < verdict_.min_clearance_m) {
      verdict_.min_clearance_m = clearance_m;
      verdict_.min_clearance_at_s = t;
    }
    if (clearance_m <= 0.0) {
      Collision collision{t, object_id, true, ""};
      if (!rests) {
        collision.cause = object_id == 0 ? "drove into something static" : "struck while moving";
      } else if (!mission_.MayStand(state.position_W, 0.0)) {
        collision.cause = "stood on a carriageway";
      } else if (t - *stands_since_s_ < kLongEnough_s) {
        collision.cause = "had just moved into the way";
      } else {
        collision.caused = false;
        collision.cause = "run over while standing where it may";
      }
      verdict_.collision = collision;
      return;
    }
    if (rests && !verdict_.reached_s &&
        (state.position_W - mission_.goal_W).norm() <= mission_.goal_radius_m) {
      verdict_.reached_s = t;
    }
    t += std::clamp(clearance_m / kClosing_mps, kShortest_s, kLongest_s);
  }
}

}  // namespace clearance::demo
