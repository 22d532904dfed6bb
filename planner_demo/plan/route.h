// A curve through waypoints, without times.
#pragma once

#include <memory>
#include <vector>

#include "planner_demo/plan/space_time.h"
#include "planner_demo/plan/speed_profile.h"

namespace clearance::demo {

class Route {
 public:
  // Shortest curves from each waypoint's pose to the next one's; speeds and times do not count.
  Route(std::shared_ptr<const SpaceTime> space, std::vector<RobotState> waypoints);

  const std::vector<RobotState>& waypoints() const { return waypoints_; }
  double length_m() const { return ends_m_.back(); }
  // Climbs no steeper than the robot can.
  bool feasible() const { return feasible_; }
  RobotState At(double at_m) const;

  // The states of a speed plan along the curve, from `start` (its pose may turn to the curve's at
  // rest). Waypoints become states of their own, so that the space's steering follows the curve.
  std::vector<RobotState> Timed(const RobotState& start, const SpeedPlan& plan,
                                double earliest_start_s) const;

 private:
  std::shared_ptr<const SpaceTime> space_;
  std::vector<RobotState> waypoints_;
  std::vector<double> ends_m_;  // length up to waypoint i
  bool feasible_ = true;
};

}  // namespace clearance::demo
