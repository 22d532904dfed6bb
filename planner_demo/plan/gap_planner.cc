#include "planner_demo/plan/gap_planner.h"

#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/geometric/PathGeometric.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "planner_demo/plan/motion_validator.h"
#include "planner_demo/plan/ride_objective.h"

namespace clearance::demo {
namespace {

namespace ob = ompl::base;
constexpr double kRest_mps = 1e-3;
constexpr double kStandRoom_m = 0.5;  // from carriageways
constexpr double kDetourEnd_s = 1.5;  // for a route that does not lead to the goal
constexpr double kShortest_m = 0.3;
constexpr double kArrives_m = 0.2;  // within the goal's radius by so much: columns are coarse
constexpr double kEasyBrake_mps2 = 2.0;
constexpr double kTurnAtRest_rad = 0.35;
constexpr int kDraws = 10;
constexpr double kOnCarriageway = 0.3;  // a second there costs so much more: nobody loiters

double Heading(const Eigen::Vector3d& from_W, const Eigen::Vector3d& to_W) {
  return std::atan2(to_W.y() - from_W.y(), to_W.x() - from_W.x());
}

// What comes behind the arrival is no part of the plan.
void EndAtGoal(const SpeedProblem& problem, SpeedPlan& plan) {
  for (size_t k = 1; k + 1 < plan.knots.size(); ++k) {
    const size_t column = static_cast<size_t>(plan.knots[k].at_m / SpeedProblem::kStep_m + 0.5);
    if (plan.knots[k].speed_mps > 0.0 || column >= problem.at_goal.size()) continue;
    if (problem.at_goal[column]) plan.knots.resize(k + 1);
  }
}

}  // namespace

Destination::Destination(const ob::SpaceInformationPtr& si, const Mission& mission)
    : ob::GoalRegion(si), goal_W_(mission.goal_W) {
  setThreshold(mission.goal_radius_m);
}

double Destination::distanceGoal(const ob::State* state) const {
  return (SpaceTime::Read(state).position_W - goal_W_).norm();
}

GapPlanner::GapPlanner(const ob::SpaceInformationPtr& si, const ClearanceProbe& probe,
                       const Mission& mission, const GapPlannerOptions& options,
                       std::vector<RobotState> keep)
    : ob::Planner(si, "GapPlanner"),
      space_(std::static_pointer_cast<const SpaceTime>(si->getStateSpace())),
      probe_(probe),
      mission_(mission),
      options_(options),
      keep_(std::move(keep)),
      random_(options.seed) {
  specs_.approximateSolutions = true;
  specs_.optimizingPaths = true;
  specs_.directed = true;
}

void GapPlanner::AddCandidate(const RobotState& start, std::vector<RobotState> via, bool to_goal,
                              std::vector<Candidate>& candidates) const {
  Candidate candidate;
  candidate.to_goal = to_goal;
  RobotState first = start;
  if (start.speed_mps < kRest_mps) {
    // A turn about itself pays for larger angles; the curve makes the smaller ones on the way.
    const double heading_rad = Heading(start.position_W, via.front().position_W);
    const double turn_rad = std::abs(std::remainder(heading_rad - start.heading_rad, 2.0 * M_PI));
    if (turn_rad > kTurnAtRest_rad) {
      first.heading_rad = heading_rad;
      candidate.earliest_start_s = turn_rad / space_->robot().turn_rate_radps;
    }
  }
  via.insert(via.begin(), first);
  candidate.route = std::make_shared<Route>(space_, std::move(via));
  if (candidate.route->feasible() && candidate.route->length_m() > kShortest_m) {
    candidates.push_back(std::move(candidate));
  }
}

// The way being driven, the one straight to the goal, straight on, and ways through one or two
// random waypoints; some end at one, to get out of the way.
std::vector<GapPlanner::Candidate> GapPlanner::DrawRoutes(const RobotState& start,
                                                          bool first_round) {
  std::vector<Candidate> candidates;
  const auto towards = [](const Eigen::Vector3d& at_W, double heading_rad) {
    RobotState pose;
    pose.position_W = at_W;
    pose.heading_rad = heading_rad;
    return pose;
  };
  const auto draw = [&] {
    // Half of them where the robot may wait: ways that cross one road at a time.
    Eigen::Vector3d at_W;
    int tries = random_.Index(2) == 0 ? 1 : kDraws;
    do {
      for (int axis = 0; axis < 3; ++axis) {
        at_W[axis] = random_.Uniform(mission_.min_W[axis], mission_.max_W[axis]);
      }
    } while (--tries > 0 && !mission_.MayStand(at_W, kStandRoom_m));
    return at_W;
  };
  const Eigen::Vector3d& goal_W = mission_.goal_W;
  if (first_round) {
    if (!keep_.empty()) {
      AddCandidate(start, keep_, (keep_.back().position_W - goal_W).norm() < 0.01, candidates);
      if (!candidates.empty()) candidates.back().kept = true;
    }
    AddCandidate(start, {towards(goal_W, Heading(start.position_W, goal_W))}, true, candidates);
    // Straight on, to come to rest: at the goal when it is near, or because nothing else is left.
    const double stop_m = 1.0 + 0.5 * start.speed_mps * start.speed_mps / kEasyBrake_mps2;
    AddCandidate(
        start,
        {towards(start.position_W + stop_m * Eigen::Vector3d(std::cos(start.heading_rad),
                                                             std::sin(start.heading_rad), 0.0),
                 start.heading_rad)},
        false, candidates);
  }
  for (int attempt = 0;
       attempt < 3 * options_.routes && candidates.size() < static_cast<size_t>(options_.routes);
       ++attempt) {
    const int kind = random_.Index(8);
    Eigen::Vector3d a_W = draw();
    if (kind >= 6) {
      // Near, to step aside; a stop that leads on to the goal later.
      a_W = start.position_W + (a_W - start.position_W).normalized() * random_.Uniform(1.0, 7.0);
      a_W = a_W.cwiseMax(mission_.min_W).cwiseMin(mission_.max_W);
      if (!mission_.MayStand(a_W, kStandRoom_m)) continue;
      AddCandidate(start, {towards(a_W, Heading(start.position_W, a_W))}, false, candidates);
    } else if (kind >= 2) {
      AddCandidate(
          start,
          {towards(a_W, Heading(start.position_W, goal_W)), towards(goal_W, Heading(a_W, goal_W))},
          true, candidates);
    } else {
      const Eigen::Vector3d b_W = draw();
      AddCandidate(start,
                   {towards(a_W, Heading(start.position_W, b_W)),
                    towards(b_W, Heading(a_W, goal_W)), towards(goal_W, Heading(b_W, goal_W))},
                   true, candidates);
    }
    // A way much longer than others is not worth its look-ups.
    const double direct_m = (goal_W - start.position_W).norm();
    if (!candidates.empty() && candidates.back().route->length_m() > 2.0 * direct_m + 15.0) {
      candidates.pop_back();
    }
  }
  return candidates;
}

// Looks every place within reach up at every time, and plans the speeds.
bool GapPlanner::Evaluate(const RobotState& start, std::vector<Candidate>& candidates) const {
  std::vector<RobotState> samples;
  for (Candidate& candidate : candidates) {
    SpeedProblem& problem = candidate.problem;
    const RobotModel& robot = space_->robot();
    problem.length_m = candidate.route->length_m();
    problem.start_mps = start.speed_mps;
    problem.earliest_start_s = candidate.earliest_start_s;
    problem.horizon_s = options_.horizon_s;
    problem.limits = {std::max(options_.max_speed_mps, 0.5), robot.max_accel_mps2,
                      robot.max_brake_mps2};
    if (!candidate.to_goal) {
      const Eigen::Vector3d end_W = candidate.route->waypoints().back().position_W;
      problem.beyond_end_s = kDetourEnd_s + (mission_.goal_W - end_W).norm() / robot.max_speed_mps;
    }
    const double reach_m = ReachAt(problem, problem.horizon_s + 1.0).to_m;
    problem.columns = static_cast<int>(reach_m / SpeedProblem::kStep_m) + 2;
    std::vector<RobotState> places(problem.columns);
    problem.may_stand.resize(problem.columns);
    problem.at_goal.resize(problem.columns);
    for (int c = 0; c < problem.columns; ++c) {
      places[c] = candidate.route->At(c * SpeedProblem::kStep_m);
      problem.may_stand[c] = mission_.MayStand(places[c].position_W, kStandRoom_m);
      problem.at_goal[c] =
          (places[c].position_W - mission_.goal_W).norm() < mission_.goal_radius_m - kArrives_m;
    }
    candidate.first_sample = samples.size();
    for (int row = 0; row < problem.Rows(); ++row) {
      const double t = row * SpeedProblem::kStep_s;
      const Reach reach = ReachAt(problem, t);
      for (int c = static_cast<int>(reach.from_m / SpeedProblem::kStep_m);
           c < problem.columns && c * SpeedProblem::kStep_m <= reach.to_m + SpeedProblem::kStep_m;
           ++c) {
        samples.push_back(places[c]);
        samples.back().time_s = start.time_s + t;
      }
    }
  }
  const auto clearances = probe_.At(samples);
  if (!clearances.ok()) return false;
  for (Candidate& candidate : candidates) {
    SpeedProblem& problem = candidate.problem;
    problem.rate.assign(static_cast<size_t>(problem.Rows()) * problem.columns, 0.0F);
    size_t at = candidate.first_sample;
    for (int row = 0; row < problem.Rows(); ++row) {
      const Reach reach = ReachAt(problem, row * SpeedProblem::kStep_s);
      for (int c = static_cast<int>(reach.from_m / SpeedProblem::kStep_m);
           c < problem.columns && c * SpeedProblem::kStep_m <= reach.to_m + SpeedProblem::kStep_m;
           ++c, ++at) {
        const Clearance& clearance = (*clearances)[at];
        problem.rate[static_cast<size_t>(row) * problem.columns + c] +=
            static_cast<float>(RideObjective::Rate(clearance) +
                               (problem.may_stand[c] ? 0.0 : kOnCarriageway));
        if (clearance.beyond_margin_m >= 0.0F) continue;
        // What is there now may have come, and may leave, a step sooner or later.
        const float collides = SpeedProblem::kCollides * (1.0F - clearance.beyond_margin_m);
        for (int near = std::max(0, row - 1); near <= std::min(row + 1, problem.Rows() - 1);
             ++near) {
          float& rate = problem.rate[static_cast<size_t>(near) * problem.columns + c];
          rate = std::max(rate, collides);
        }
      }
    }
    candidate.plan = PlanSpeeds(problem);
    EndAtGoal(problem, candidate.plan);
    if (candidate.kept) candidate.plan.cost -= options_.keep_bonus_s;
  }
  return true;
}

void GapPlanner::Keep(const RobotState& start, std::vector<Candidate>& candidates) {
  constexpr int kChecked = 4;
  std::erase_if(candidates, [](const Candidate& c) { return c.plan.knots.empty(); });
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.plan.cost < b.plan.cost; });
  const auto& validator =
      *static_cast<const ClearanceMotionValidator*>(si_->getMotionValidator().get());
  for (size_t i = 0; i < candidates.size() && i < kChecked; ++i) {
    const Candidate& candidate = candidates[i];
    if (safe_ && candidate.plan.cost >= cost_) return;
    std::vector<RobotState> states =
        candidate.route->Timed(start, candidate.plan, candidate.earliest_start_s);
    const bool safe = !candidate.plan.collides && !validator.FirstInvalid(states);
    if (!safe && (safe_ || (!solution_.empty() && candidate.plan.cost >= cost_))) continue;
    safe_ = safe;
    cost_ = candidate.plan.cost;
    waypoints_.assign(candidate.route->waypoints().begin() + 1, candidate.route->waypoints().end());
    // Waypoints that the plan's first second passes are not needed any more.
    solution_ = std::move(states);
    if (safe) return;
  }
}

ob::PlannerStatus GapPlanner::solve(const ob::PlannerTerminationCondition& ptc) {
  checkValidity();
  if (pdef_->getStartStateCount() == 0) return ob::PlannerStatus::INVALID_START;
  // Too close to something is no reason not to plan: it is one to get away.
  const RobotState start = SpaceTime::Read(pdef_->getStartState(0));
  safe_ = false;
  cost_ = std::numeric_limits<double>::infinity();
  solution_.clear();
  for (int round = 0; round < options_.rounds && (round == 0 || !ptc()); ++round) {
    std::vector<Candidate> candidates = DrawRoutes(start, round == 0);
    if (candidates.empty() || !Evaluate(start, candidates)) break;
    Keep(start, candidates);
  }
  if (solution_.empty()) return ob::PlannerStatus::TIMEOUT;
  auto path = std::make_shared<ompl::geometric::PathGeometric>(si_);
  ob::ScopedState<> state(si_->getStateSpace());
  for (const RobotState& knot : solution_) {
    SpaceTime::Write(knot, state.get());
    path->append(state.get());
  }
  double left_m = 0.0;
  const bool exact = safe_ && pdef_->getGoal()->isSatisfied(path->getStates().back(), &left_m);
  pdef_->addSolutionPath(path, !exact, left_m, getName());
  return exact ? ob::PlannerStatus::EXACT_SOLUTION : ob::PlannerStatus::APPROXIMATE_SOLUTION;
}

}  // namespace clearance::demo
