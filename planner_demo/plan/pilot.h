// Replans as the map changes, and says where the robot is in between.
#pragma once

#include <ompl/base/SpaceInformation.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "planner_demo/plan/clearance_probe.h"
#include "planner_demo/plan/gap_planner.h"
#include "planner_demo/plan/mission.h"

namespace clearance::demo {

struct PilotOptions {
  double latency_s = 0.2;      // a plan begun at t is driven from t + latency_s
  double slow_after_s = 0.35;  // a map older than this slows the robot down,
  double stop_after_s = 1.0;   // one older than this stops it
  GapPlannerOptions planner;
};

struct Cycle {
  double begun_s = 0.0;
  double wall_ms = 0.0, cpu_ms = 0.0;  // of the planning thread
  uint64_t lookups = 0;
  bool safe = false;   // checked from end to end
  bool blind = false;  // the map is too old or cannot be asked: the robot stops
  bool late = false;   // computed for longer than latency_s: thrown away
  double cost = 0.0;
  std::string problem;  // where planning failed
};

// Not thread-safe. Exceptions of OMPL end here.
class Pilot {
 public:
  Pilot(const RobotModel& robot, const Mission& mission, ClearanceProbe& probe,
        const PilotOptions& options);

  // Plans on a map whose newest frame is of `map_time_s`; calls come in the order of `now_s`.
  Cycle Plan(double now_s, double map_time_s);

  // What is driven: valid up to latency_s behind the newest cycle, planned beyond.
  RobotState At(double time_s) const;
  // The newest plan (absent before the first).
  const Trajectory& plan() const { return next_; }

 private:
  void Solve(const RobotState& start, double map_time_s, double max_speed_mps, Cycle& cycle);
  bool StaysSafe(const RobotState& start, const ompl::base::SpaceInformation& si) const;
  // Brakes easily along what is being driven.
  void Stop(const RobotState& start);
  std::vector<RobotState> Ahead(double time_s) const;

  const RobotModel robot_;
  const Mission mission_;
  ClearanceProbe& probe_;
  const PilotOptions options_;
  Trajectory current_, next_;
  std::vector<RobotState> waypoints_;  // of next_
  double switch_s_ = 0.0;
  uint64_t cycles_ = 0;
};

// At full speed on the straight line, without a look at anything.
Trajectory StraightAhead(const RobotModel& robot, const Mission& mission, double start_s);

}  // namespace clearance::demo
