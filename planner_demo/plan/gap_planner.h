// A planner in space and time for OMPL 1.5, which has none: it finds gaps in traffic.
#pragma once

#include <ompl/base/Planner.h>
#include <ompl/base/goals/GoalRegion.h>

#include <memory>
#include <string>
#include <vector>

#include "planner_demo/plan/clearance_probe.h"
#include "planner_demo/plan/mission.h"
#include "planner_demo/plan/route.h"
#include "planner_demo/sim/random.h"

namespace clearance::demo {

// A place, at any time.
class Destination final : public ompl::base::GoalRegion {
 public:
  Destination(const ompl::base::SpaceInformationPtr& si, const Mission& mission);
  double distanceGoal(const ompl::base::State* state) const override;

 private:
  const Eigen::Vector3d goal_W_;
};

struct GapPlannerOptions {
  int routes = 20;             // a round
  int rounds = 1;              // at most; fewer where the termination condition says so
  double horizon_s = 6.0;      // plans are so long
  double max_speed_mps = 4.0;  // below the robot's: slower than it could
  double keep_bonus_s = 0.4;   // what another route must gain over the one being driven
  uint64_t seed = 0;
};

// Draws routes through random waypoints, looks up the clearance of every place on them at every
// time within reach in one batch, and finds each route's best speeds by dynamic programming: in
// time between, before or behind what moves. The best plans are checked by the motion validator;
// the first that passes is the solution: exact where it reaches the goal, else approximate, ending
// where the robot may stand. Where nothing passes, the plan that collides last and least is left as
// the approximate solution and `safe()` says no. The same seed and map give the same plan.
class GapPlanner final : public ompl::base::Planner {
 public:
  // `probe` must outlive the planner; `keep` are the waypoints of the plan being driven.
  GapPlanner(const ompl::base::SpaceInformationPtr& si, const ClearanceProbe& probe,
             const Mission& mission, const GapPlannerOptions& options,
             std::vector<RobotState> keep = {});

  ompl::base::PlannerStatus solve(const ompl::base::PlannerTerminationCondition& ptc) override;

  // Of the newest solution.
  bool safe() const { return safe_; }
  double cost() const { return cost_; }
  const std::vector<RobotState>& waypoints() const { return waypoints_; }
  const std::vector<RobotState>& solution() const { return solution_; }

 private:
  struct Candidate {
    std::shared_ptr<Route> route;
    double earliest_start_s = 0.0;
    bool to_goal = false;
    bool kept = false;
    SpeedProblem problem;
    SpeedPlan plan;
    size_t first_sample = 0;
  };

  void AddCandidate(const RobotState& start, std::vector<RobotState> via, bool to_goal,
                    std::vector<Candidate>& candidates) const;
  std::vector<Candidate> DrawRoutes(const RobotState& start, bool first_round);
  bool Evaluate(const RobotState& start, std::vector<Candidate>& candidates) const;
  void Keep(const RobotState& start, std::vector<Candidate>& candidates);

  std::shared_ptr<const SpaceTime> space_;
  const ClearanceProbe& probe_;
  const Mission mission_;
  const GapPlannerOptions options_;
  const std::vector<RobotState> keep_;
  sim::Random random_;
  bool safe_ = false;
  double cost_ = 0.0;
  std::vector<RobotState> waypoints_;
  std::vector<RobotState> solution_;
};

}  // namespace clearance::demo
