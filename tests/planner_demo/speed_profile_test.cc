#include "planner_demo/plan/speed_profile.h"

#include <gtest/gtest.h>

#include <cmath>

namespace clearance::demo {
namespace {

SpeedProblem Open(double length_m) {
  SpeedProblem problem;
  problem.length_m = length_m;
  problem.columns = static_cast<int>(length_m / SpeedProblem::kStep_m) + 2;
  problem.rate.assign(static_cast<size_t>(problem.Rows()) * problem.columns, 0.0F);
  problem.may_stand.assign(problem.columns, 1);
  problem.at_goal.assign(problem.columns, 0);
  for (int c = 0; c < problem.columns; ++c) {
    problem.at_goal[c] = std::abs(length_m - c * SpeedProblem::kStep_m) < 0.4;
  }
  return problem;
}

// Whatever stands between two places from one time to another.
void Block(SpeedProblem& problem, double from_m, double to_m, double from_s, double to_s) {
  for (int row = 0; row < problem.Rows(); ++row) {
    const double t = row * SpeedProblem::kStep_s;
    for (int c = 0; c < problem.columns; ++c) {
      const double at_m = c * SpeedProblem::kStep_m;
      if (t >= from_s && t <= to_s && at_m >= from_m && at_m <= to_m) {
        problem.rate[static_cast<size_t>(row) * problem.columns + c] = SpeedProblem::kCollides;
      }
    }
  }
}

double PlaceAt(const SpeedPlan& plan, double time_s) {
  for (size_t i = 1; i < plan.knots.size(); ++i) {
    const SpeedKnot& a = plan.knots[i - 1];
    const SpeedKnot& b = plan.knots[i];
    if (time_s > b.time_s) continue;
    const double t = time_s - a.time_s;
    const double accel = (b.speed_mps - a.speed_mps) / (b.time_s - a.time_s);
    return a.at_m + t * (a.speed_mps + 0.5 * accel * t);
  }
  return plan.knots.back().at_m;
}

void ExpectWithinLimits(const SpeedPlan& plan, const SpeedProblem& problem) {
  for (size_t i = 1; i < plan.knots.size(); ++i) {
    const SpeedKnot& a = plan.knots[i - 1];
    const SpeedKnot& b = plan.knots[i];
    const double duration_s = b.time_s - a.time_s;
    ASSERT_GT(duration_s, 0.0);
    const double accel = (b.speed_mps - a.speed_mps) / duration_s;
    EXPECT_LE(accel, problem.limits.max_accel_mps2 + 1e-6);
    EXPECT_GE(accel, -problem.limits.max_brake_mps2 - 1e-6);
    EXPECT_NEAR(b.at_m - a.at_m, 0.5 * duration_s * (a.speed_mps + b.speed_mps), 1e-4);
    EXPECT_LE(b.at_m, problem.length_m + 1e-4);
    EXPECT_LE(b.speed_mps, problem.limits.max_speed_mps + 1e-9);
  }
}

TEST(PlanSpeeds, ReachesTheGoalAboutAsFastAsTheLimitsAllow) {
  const SpeedProblem problem = Open(12.0);
  const SpeedPlan plan = PlanSpeeds(problem);
  ExpectWithinLimits(plan, problem);
  EXPECT_FALSE(plan.collides);
  EXPECT_NEAR(plan.knots.back().at_m, 12.0, 0.4);
  EXPECT_EQ(plan.knots.back().speed_mps, 0.0);
  // 12 m from rest to rest take 12/4 + 4/2 = 5 s when braking with 2 m/s^2, 4.5 s with 4.
  EXPECT_LT(plan.cost, 5.5);
  EXPECT_GT(plan.cost, 4.0);
}

TEST(PlanSpeeds, WaitsForAGapAndTakesIt) {
  SpeedProblem problem = Open(16.0);
  Block(problem, 6.0, 9.0, 1.0, 3.5);
  const SpeedPlan plan = PlanSpeeds(problem);
  ExpectWithinLimits(plan, problem);
  EXPECT_FALSE(plan.collides);
  for (double t = 1.0; t <= 3.5; t += 0.05) EXPECT_LT(PlaceAt(plan, t), 6.2);
  EXPECT_GT(plan.knots.back().at_m, 9.0);
}

TEST(PlanSpeeds, GoesAheadOfWhatComesLater) {
  SpeedProblem problem = Open(14.0);
  Block(problem, 3.0, 5.0, 3.0, 6.0);
  const SpeedPlan plan = PlanSpeeds(problem);
  EXPECT_FALSE(plan.collides);
  EXPECT_GT(PlaceAt(plan, 3.0), 5.0);
}

TEST(PlanSpeeds, DoesNotEndWhereNobodyMayStand) {
  SpeedProblem problem = Open(40.0);
  for (int c = 0; c < problem.columns; ++c) {
    const double at_m = c * SpeedProblem::kStep_m;
    problem.may_stand[c] = at_m < 4.0 || at_m > 35.0;  // out of reach within the horizon
  }
  const SpeedPlan plan = PlanSpeeds(problem);
  ExpectWithinLimits(plan, problem);
  const SpeedKnot& end = plan.knots.back();
  EXPECT_LT(end.at_m + 0.25 * end.speed_mps * end.speed_mps, 4.3);
}

TEST(PlanSpeeds, PutsACollisionOffThatCannotBeAvoided) {
  SpeedProblem problem = Open(20.0);
  problem.start_mps = 4.0;
  Block(problem, 1.0, 20.0, 0.0, 6.0);  // stopping takes 2 m
  const SpeedPlan plan = PlanSpeeds(problem);
  EXPECT_TRUE(plan.collides);
  EXPECT_LE(plan.knots[2].speed_mps, 0.5);  // brakes as hard as it can
}

TEST(PlanSpeeds, StandsUntilItHasTurned) {
  SpeedProblem problem = Open(10.0);
  problem.earliest_start_s = 1.2;
  const SpeedPlan plan = PlanSpeeds(problem);
  EXPECT_EQ(PlaceAt(plan, 1.4), 0.0);
  EXPECT_GT(plan.knots.back().at_m, 5.0);
}

}  // namespace
}  // namespace clearance::demo
