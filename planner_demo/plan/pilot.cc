#include "planner_demo/plan/pilot.h"

#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

#include "planner_demo/plan/motion_validator.h"
#include "planner_demo/plan/ride_objective.h"

namespace clearance::demo {
namespace {

namespace ob = ompl::base;
constexpr double kEasyBrake_mps2 = 2.5;
constexpr double kPassed_m = 1e-3;
constexpr double kPassed_s = 1e-6;

double ThreadCpuMs() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

std::shared_ptr<SpaceTime> MakeSpace(const RobotModel& robot, const Mission& mission, double from_s,
                                     double to_s) {
  return std::make_shared<SpaceTime>(robot,
                                     SpaceTime::Bounds{mission.min_W, mission.max_W, from_s, to_s});
}

}  // namespace

Pilot::Pilot(const RobotModel& robot, const Mission& mission, ClearanceProbe& probe,
             const PilotOptions& options)
    : robot_(robot), mission_(mission), probe_(probe), options_(options) {
  current_ = Trajectory(MakeSpace(robot, mission, 0.0, 1.0), {mission.start});
  next_ = current_;
}

RobotState Pilot::At(double time_s) const {
  return time_s < switch_s_ ? current_.At(time_s) : next_.At(time_s);
}

// What is left of the route behind `time_s`.
std::vector<RobotState> Pilot::Ahead(double time_s) const {
  size_t passed = 0;
  for (size_t i = 0; i + 1 < waypoints_.size(); ++i) {
    for (const RobotState& state : next_.states()) {
      if (state.time_s <= time_s &&
          (state.position_W - waypoints_[i].position_W).norm() < kPassed_m) {
        passed = i + 1;
      }
    }
  }
  return {waypoints_.begin() + static_cast<std::ptrdiff_t>(passed), waypoints_.end()};
}

Cycle Pilot::Plan(double now_s, double map_time_s) {
  const auto wall = std::chrono::steady_clock::now();
  const double cpu_ms = ThreadCpuMs();
  const uint64_t lookups = probe_.lookups();
  Cycle cycle;
  cycle.begun_s = now_s;
  const double effect_s = now_s + options_.latency_s;
  RobotState start = At(effect_s);
  start.speed_mps = std::clamp(start.speed_mps, 0.0, robot_.max_speed_mps);
  const Trajectory driven = next_;
  const Trajectory before = current_;
  const double switched_s = switch_s_;
  const std::vector<RobotState> waypoints = waypoints_;

  const double age_s = now_s - map_time_s;
  if (age_s < options_.stop_after_s) {
    const double share = std::clamp(
        (options_.stop_after_s - age_s) / (options_.stop_after_s - options_.slow_after_s), 0.0,
        1.0);
    const double max_speed_mps = std::min(robot_.max_speed_mps, options_.planner.max_speed_mps);
    Solve(start, map_time_s, std::max(share * max_speed_mps, start.speed_mps - 1.5), cycle);
  } else {
    cycle.problem = "the map is too old";
  }
  if (!cycle.problem.empty()) {
    cycle.blind = true;
    Stop(start);
  }
  cycle.wall_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - wall).count();
  cycle.cpu_ms = ThreadCpuMs() - cpu_ms;
  cycle.lookups = probe_.lookups() - lookups;
  cycle.late = cycle.cpu_ms > 1e3 * options_.latency_s && !cycle.blind;
  if (cycle.late) {
    current_ = before;
    next_ = driven;
    switch_s_ = switched_s;
    waypoints_ = waypoints;
  } else {
    current_ = driven;
    switch_s_ = effect_s;
  }
  return cycle;
}

void Pilot::Solve(const RobotState& start, double map_time_s, double max_speed_mps, Cycle& cycle) {
  GapPlannerOptions options = options_.planner;
  options.max_speed_mps = max_speed_mps;
  options.seed = options_.planner.seed * 100003 + ++cycles_;
  probe_.SetMapTime(map_time_s);
  probe_.ClearStatus();
  try {
    const auto space =
        MakeSpace(robot_, mission_, start.time_s - 1.0, start.time_s + options.horizon_s + 1.0);
    const auto si = std::make_shared<ob::SpaceInformation>(space);
    si->setStateValidityChecker(std::make_shared<ClearanceStateValidity>(si, probe_));
    si->setMotionValidator(std::make_shared<ClearanceMotionValidator>(si, probe_));
    si->setup();
    const auto problem = std::make_shared<ob::ProblemDefinition>(si);
    ob::ScopedState<> from(std::static_pointer_cast<ob::StateSpace>(space));
    SpaceTime::Write(start, from.get());
    problem->addStartState(from);
    problem->setGoal(std::make_shared<Destination>(si, mission_));
    problem->setOptimizationObjective(std::make_shared<RideObjective>(si, probe_, mission_.goal_W));
    GapPlanner planner(si, probe_, mission_, options, Ahead(start.time_s));
    planner.setProblemDefinition(problem);
    planner.setup();
    const ob::PlannerStatus status = planner.solve(ob::plannerNonTerminatingCondition());
    if (!probe_.status().ok()) {
      cycle.problem = std::string(probe_.status().message());
    } else if (!status) {
      cycle.problem = "no plan: " + status.asString();
    } else {
      cycle.safe = planner.safe();
      cycle.cost = planner.cost();
      if (!cycle.safe && StaysSafe(start, *si)) {
        cycle.safe = true;  // what is being driven
        return;
      }
      waypoints_ = planner.waypoints();
      next_ = Trajectory(space, planner.solution());
    }
  } catch (const std::exception& error) {
    cycle.problem = error.what();
  }
}

// Whether what is left of the plan being driven still keeps its margins and ends at rest where the
// robot may stand.
bool Pilot::StaysSafe(const RobotState& start, const ob::SpaceInformation& si) const {
  std::vector<RobotState> left = {start};
  for (const RobotState& state : next_.states()) {
    if (state.time_s > start.time_s + kPassed_s) left.push_back(state);
  }
  const RobotState& end = left.back();
  if (left.size() < 2 || end.speed_mps > 0.0 || !mission_.MayStand(end.position_W, 0.0)) {
    return false;
  }
  return !static_cast<const ClearanceMotionValidator&>(*si.getMotionValidator()).FirstInvalid(left);
}

void Pilot::Stop(const RobotState& start) {
  std::vector<RobotState> stop = {start};
  if (start.speed_mps > 0.0) {
    // The places that were to come, reached ever later.
    double travelled_m = 0.0, passed_s = 0.0;
    RobotState last = start;
    const double stops_m = 0.5 * start.speed_mps * start.speed_mps / kEasyBrake_mps2;
    for (double t = start.time_s + 0.05; travelled_m < stops_m && t < start.time_s + 20.0;
         t += 0.05) {
      RobotState at = At(t);
      const double step_m = (at.position_W - last.position_W).norm();
      if (step_m < 1e-4) break;
      travelled_m = std::min(travelled_m + step_m, stops_m);
      at.speed_mps = std::sqrt(std::max(0.0, 2.0 * kEasyBrake_mps2 * (stops_m - travelled_m)));
      if (at.speed_mps < 0.3) at.speed_mps = 0.0;
      passed_s += step_m / std::max(0.1, 0.5 * (at.speed_mps + last.speed_mps));
      at.time_s = start.time_s + passed_s;
      stop.push_back(at);
      last = at;
      if (at.speed_mps == 0.0) break;
    }
    stop.back().speed_mps = 0.0;
  }
  next_ = Trajectory(MakeSpace(robot_, mission_, start.time_s, start.time_s + 20.0), stop);
  waypoints_.clear();
}

Trajectory StraightAhead(const RobotModel& robot, const Mission& mission, double start_s) {
  constexpr double kBrake_mps2 = 2.0;
  const Eigen::Vector3d way_W = mission.goal_W - mission.start.position_W;
  const double up_m = 0.5 * robot.max_speed_mps * robot.max_speed_mps / robot.max_accel_mps2;
  const double down_m = 0.5 * robot.max_speed_mps * robot.max_speed_mps / kBrake_mps2;
  const double cruise_s = std::max(0.0, way_W.norm() - up_m - down_m) / robot.max_speed_mps;
  RobotState state = mission.start;
  state.heading_rad = std::atan2(way_W.y(), way_W.x());
  state.time_s = start_s;
  std::vector<RobotState> states = {state};
  const auto add = [&](double length_m, double duration_s, double speed_mps) {
    state.position_W += length_m * way_W.normalized();
    state.time_s += duration_s;
    state.speed_mps = speed_mps;
    states.push_back(state);
  };
  add(up_m, robot.max_speed_mps / robot.max_accel_mps2, robot.max_speed_mps);
  add(cruise_s * robot.max_speed_mps, cruise_s, robot.max_speed_mps);
  add(way_W.norm() - up_m - down_m - cruise_s * robot.max_speed_mps + down_m,
      robot.max_speed_mps / kBrake_mps2, 0.0);
  return Trajectory(MakeSpace(robot, mission, start_s, state.time_s + 1.0), states);
}

}  // namespace clearance::demo
