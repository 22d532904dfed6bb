#include "planner_demo/plan/ride_objective.h"

#include <ompl/base/SpaceInformation.h>

#include <cmath>

namespace clearance::demo {

namespace ob = ompl::base;

RideObjective::RideObjective(const ob::SpaceInformationPtr& si, const ClearanceProbe& probe,
                             const Eigen::Vector3d& goal_W)
    : ob::OptimizationObjective(si),
      space_(*si->getStateSpace()->as<SpaceTime>()),
      probe_(probe),
      goal_W_(goal_W) {
  description_ = "time and clearance";
}

double RideObjective::Left(const RobotState& state) const {
  return (goal_W_ - state.position_W).norm() / space_.robot().max_speed_mps;
}

ob::Cost RideObjective::stateCost(const ob::State* state) const {
  const auto clearances = probe_.At({SpaceTime::Read(state)});
  return ob::Cost(clearances.ok() ? Rate((*clearances)[0]) : kDiscomfort);
}

ob::Cost RideObjective::motionCost(const ob::State* from, const ob::State* to) const {
  constexpr double kStep_s = 0.2;
  const RobotState a = SpaceTime::Read(from), b = SpaceTime::Read(to);
  const Steering steering = space_.Steer(a, b);
  if (!steering.feasible) return infiniteCost();
  const int steps = 1 + static_cast<int>(steering.duration_s / kStep_s);
  std::vector<RobotState> samples;
  for (int k = 1; k <= steps; ++k) {
    samples.push_back(space_.Along(a, b, steering, steering.duration_s * k / steps));
  }
  const auto clearances = probe_.At(samples);
  if (!clearances.ok()) return infiniteCost();
  double discomfort_s = 0.0;
  for (const Clearance& clearance : *clearances) {
    discomfort_s += Rate(clearance) * steering.duration_s / steps;
  }
  return ob::Cost(steering.duration_s + discomfort_s + Left(b) - Left(a));
}

}  // namespace clearance::demo
