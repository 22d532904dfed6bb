#include "planner_demo/plan/route.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace clearance::demo {

Route::Route(std::shared_ptr<const SpaceTime> space, std::vector<RobotState> waypoints)
    : space_(std::move(space)), waypoints_(std::move(waypoints)), ends_m_(1, 0.0) {
  for (size_t i = 0; i + 1 < waypoints_.size(); ++i) {
    const double ground_m = space_->GroundLength(waypoints_[i], waypoints_[i + 1]);
    const double climb_m =
        std::abs(waypoints_[i + 1].position_W.z() - waypoints_[i].position_W.z());
    feasible_ = feasible_ && climb_m <= space_->robot().max_climb * ground_m + 1e-6;
    ends_m_.push_back(ends_m_.back() + std::hypot(ground_m, climb_m));
  }
}

RobotState Route::At(double at_m) const {
  const auto after = std::upper_bound(ends_m_.begin() + 1, ends_m_.end() - 1, at_m);
  const size_t i = static_cast<size_t>(after - ends_m_.begin()) - 1;
  const double length_m = ends_m_[i + 1] - ends_m_[i];
  const double share = length_m > 0.0 ? std::clamp((at_m - ends_m_[i]) / length_m, 0.0, 1.0) : 1.0;
  return space_->OnCurve(waypoints_[i], waypoints_[i + 1], share);
}

std::vector<RobotState> Route::Timed(const RobotState& start, const SpeedPlan& plan,
                                     double earliest_start_s) const {
  std::vector<RobotState> states = {start};
  const double turn_rad = std::remainder(waypoints_[0].heading_rad - start.heading_rad, 2.0 * M_PI);
  for (size_t k = 1; k < plan.knots.size(); ++k) {
    const SpeedKnot& from = plan.knots[k - 1];
    const SpeedKnot& to = plan.knots[k];
    const double accel_mps2 = (to.speed_mps - from.speed_mps) / (to.time_s - from.time_s);
    for (size_t i = 1; i + 1 < ends_m_.size(); ++i) {
      const double left_m = ends_m_[i] - from.at_m;
      if (left_m <= 1e-3 || ends_m_[i] >= to.at_m - 1e-3) continue;
      // When the waypoint is passed: left = v t + a t^2 / 2, written so that a may be 0.
      const double root =
          std::sqrt(std::max(0.0, from.speed_mps * from.speed_mps + 2.0 * accel_mps2 * left_m));
      const double passed_s = 2.0 * left_m / (from.speed_mps + root);
      RobotState state = waypoints_[i];
      state.speed_mps = from.speed_mps + accel_mps2 * passed_s;
      state.time_s = start.time_s + from.time_s + passed_s;
      states.push_back(state);
    }
    RobotState state = At(to.at_m);
    if (to.at_m < 1e-6) {
      const double turned =
          earliest_start_s > 0.0 ? std::min(1.0, to.time_s / earliest_start_s) : 1.0;
      state.position_W = start.position_W;
      state.heading_rad = start.heading_rad + turned * turn_rad;
    }
    state.speed_mps = to.speed_mps;
    state.time_s = start.time_s + to.time_s;
    states.push_back(state);
  }
  return states;
}

}  // namespace clearance::demo
