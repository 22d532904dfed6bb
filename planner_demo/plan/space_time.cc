#include "planner_demo/plan/space_time.h"

#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/base/spaces/TimeStateSpace.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "planner_demo/plan/dubins.h"

namespace clearance::demo {
namespace {

namespace ob = ompl::base;
constexpr double kSamePlace_m = 1e-6;
constexpr double kLevel_m = 1e-3;   // height differences that do not count
constexpr double kRounding = 1e-3;  // what a limit may be exceeded by: planners round places

PlanarPose Planar(const RobotState& state) {
  return {state.position_W.x(), state.position_W.y(), state.heading_rad};
}

double TurnBetween(double from_rad, double to_rad) {
  return std::remainder(to_rad - from_rad, 2.0 * M_PI);
}

// Length travelled `at_s` behind the start of the two-piece profile.
double Travelled(double from_mps, double to_mps, const Steering& steering, double at_s) {
  const double half_s = 0.5 * steering.duration_s;
  if (half_s <= 0.0) return 0.0;
  if (at_s <= half_s) {
    return at_s * (from_mps + 0.5 * (steering.middle_mps - from_mps) * at_s / half_s);
  }
  const double late_s = at_s - half_s;
  return 0.5 * half_s * (from_mps + steering.middle_mps) +
         late_s * (steering.middle_mps + 0.5 * (to_mps - steering.middle_mps) * late_s / half_s);
}

double SpeedAt(double from_mps, double to_mps, const Steering& steering, double at_s) {
  const double half_s = 0.5 * steering.duration_s;
  if (half_s <= 0.0) return to_mps;
  // Rounding must not lead out of what both ends span: the space's bounds forgive none.
  const double late = std::clamp(at_s / half_s - 1.0, -1.0, 1.0);
  const double other_mps = late < 0.0 ? from_mps : to_mps;
  return std::lerp(steering.middle_mps, other_mps, std::abs(late));
}

}  // namespace

SpaceTime::SpaceTime(const RobotModel& robot, const Bounds& bounds) : robot_(robot) {
  setName("SpaceTime");
  auto ground = std::make_shared<ob::SE2StateSpace>();
  ob::RealVectorBounds flat(2);
  for (int axis = 0; axis < 2; ++axis) {
    flat.setLow(axis, bounds.min_W[axis]);
    flat.setHigh(axis, bounds.max_W[axis]);
  }
  ground->setBounds(flat);
  auto height = std::make_shared<ob::RealVectorStateSpace>(1);
  // OMPL wants a volume; a robot that drives feels nothing of it.
  height->setBounds(bounds.min_W.z() - kLevel_m, bounds.max_W.z() + kLevel_m);
  auto speed = std::make_shared<ob::RealVectorStateSpace>(1);
  speed->setBounds(-2.0 * kRounding, robot.max_speed_mps + 2.0 * kRounding);
  auto time = std::make_shared<ob::TimeStateSpace>();
  time->setBounds(bounds.from_s, bounds.to_s);
  addSubspace(ground, 1.0);
  addSubspace(height, 1.0);
  addSubspace(speed, 1.0);
  addSubspace(time, 1.0);
  lock();
}

RobotState SpaceTime::Read(const ob::State* state) {
  const auto& parts = *state->as<ob::CompoundState>();
  const auto& ground = *parts[0]->as<ob::SE2StateSpace::StateType>();
  return {{ground.getX(), ground.getY(),
           parts[1]->as<ob::RealVectorStateSpace::StateType>()->values[0]},
          ground.getYaw(),
          parts[2]->as<ob::RealVectorStateSpace::StateType>()->values[0],
          parts[3]->as<ob::TimeStateSpace::StateType>()->position};
}

void SpaceTime::Write(const RobotState& from, ob::State* state) {
  auto& parts = *state->as<ob::CompoundState>();
  auto& ground = *parts[0]->as<ob::SE2StateSpace::StateType>();
  ground.setXY(from.position_W.x(), from.position_W.y());
  ground.setYaw(TurnBetween(0.0, from.heading_rad));
  parts[1]->as<ob::RealVectorStateSpace::StateType>()->values[0] = from.position_W.z();
  parts[2]->as<ob::RealVectorStateSpace::StateType>()->values[0] = from.speed_mps;
  parts[3]->as<ob::TimeStateSpace::StateType>()->position = from.time_s;
}

double SpaceTime::GroundLength(const RobotState& from, const RobotState& to) const {
  return DubinsCurve(Planar(from), Planar(to), robot_.turn_radius_m).length_m();
}

Steering SpaceTime::Steer(const RobotState& from, const RobotState& to) const {
  Steering steering;
  steering.duration_s = to.time_s - from.time_s;
  if (steering.duration_s <= 0.0) return steering;
  const Eigen::Vector3d step_W = to.position_W - from.position_W;
  const double turn_rad = std::abs(TurnBetween(from.heading_rad, to.heading_rad));
  if (step_W.norm() < kSamePlace_m && from.speed_mps < kRounding && to.speed_mps < kRounding) {
    // Waits, or turns about itself.
    steering.feasible = turn_rad <= robot_.turn_rate_radps * steering.duration_s + kRounding;
    return steering;
  }
  const double ground_m = GroundLength(from, to);
  steering.length_m = std::hypot(ground_m, step_W.z());
  const double half_s = 0.5 * steering.duration_s;
  steering.middle_mps = steering.length_m / half_s - 0.5 * (from.speed_mps + to.speed_mps);
  const auto within = [&](double before_mps, double after_mps) {
    const double accel_mps2 = (after_mps - before_mps) / half_s;
    return accel_mps2 <= robot_.max_accel_mps2 + kRounding &&
           -accel_mps2 <= robot_.max_brake_mps2 + kRounding;
  };
  steering.feasible = steering.middle_mps >= -kRounding &&
                      steering.middle_mps <= robot_.max_speed_mps + kRounding &&
                      within(from.speed_mps, steering.middle_mps) &&
                      within(steering.middle_mps, to.speed_mps) &&
                      std::abs(step_W.z()) <= robot_.max_climb * ground_m + 3.0 * kLevel_m;
  return steering;
}

RobotState SpaceTime::OnCurve(const RobotState& from, const RobotState& to, double share) const {
  const DubinsCurve curve(Planar(from), Planar(to), robot_.turn_radius_m);
  const PlanarPose at = curve.At(share * curve.length_m());
  RobotState result;
  result.position_W = {at.x_m, at.y_m,
                       from.position_W.z() + share * (to.position_W.z() - from.position_W.z())};
  result.heading_rad = at.heading_rad;
  return result;
}

RobotState SpaceTime::Along(const RobotState& from, const RobotState& to, const Steering& steering,
                            double at_s) const {
  RobotState result;
  if (steering.length_m <= 0.0) {
    const double share = steering.duration_s > 0.0 ? at_s / steering.duration_s : 1.0;
    result = from;
    result.heading_rad += share * TurnBetween(from.heading_rad, to.heading_rad);
    result.speed_mps = 0.0;
  } else {
    const double travelled_m = Travelled(from.speed_mps, to.speed_mps, steering, at_s);
    result = OnCurve(from, to, std::clamp(travelled_m / steering.length_m, 0.0, 1.0));
    result.speed_mps = SpeedAt(from.speed_mps, to.speed_mps, steering, at_s);
  }
  result.time_s = from.time_s + at_s;
  return result;
}

double SpaceTime::distance(const ob::State* from, const ob::State* to) const {
  const RobotState a = Read(from), b = Read(to);
  const Steering steering = Steer(a, b);
  if (steering.feasible) return steering.duration_s;
  if (steering.duration_s == 0.0 && equalStates(from, to)) return 0.0;
  return kUnreachable + std::abs(steering.duration_s) +
         (a.position_W - b.position_W).norm() / robot_.max_speed_mps;
}

void SpaceTime::interpolate(const ob::State* from, const ob::State* to, double share,
                            ob::State* state) const {
  const RobotState a = Read(from), b = Read(to);
  const Steering steering = Steer(a, b);
  if (steering.feasible) {
    Write(Along(a, b, steering, share * steering.duration_s), state);
    return;
  }
  RobotState between = OnCurve(a, b, share);
  between.speed_mps = a.speed_mps + share * (b.speed_mps - a.speed_mps);
  between.time_s = a.time_s + share * (b.time_s - a.time_s);
  Write(between, state);
}

Trajectory::Trajectory(std::shared_ptr<const SpaceTime> space, std::vector<RobotState> states)
    : space_(std::move(space)), states_(std::move(states)) {
  for (size_t i = 0; i + 1 < states_.size(); ++i) {
    steering_.push_back(space_->Steer(states_[i], states_[i + 1]));
  }
}

RobotState Trajectory::At(double time_s) const {
  RobotState at;
  if (time_s <= states_.front().time_s) {
    at = states_.front();
  } else if (time_s >= states_.back().time_s) {
    at = states_.back();
    at.speed_mps = 0.0;
  } else {
    const auto after =
        std::upper_bound(states_.begin(), states_.end(), time_s,
                         [](double t, const RobotState& state) { return t < state.time_s; });
    const size_t i = static_cast<size_t>(after - states_.begin()) - 1;
    at = space_->Along(states_[i], states_[i + 1], steering_[i], time_s - states_[i].time_s);
  }
  at.time_s = time_s;
  return at;
}

std::vector<RobotState> Trajectory::Sample(double from_s, double to_s, double step_s) const {
  std::vector<RobotState> samples;
  const int steps = std::max(1, static_cast<int>(std::ceil((to_s - from_s) / step_s)));
  for (int i = 0; i <= steps; ++i) samples.push_back(At(from_s + (to_s - from_s) * i / steps));
  return samples;
}

}  // namespace clearance::demo
