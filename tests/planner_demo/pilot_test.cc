#include "planner_demo/plan/pilot.h"

#include <gtest/gtest.h>
#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/geometric/planners/rrt/RRT.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <cmath>

#include "planner_demo/plan/motion_validator.h"
#include "tests/planner_demo/fake_world.h"

namespace clearance::demo {
namespace {

Mission Across() {
  Mission mission;
  mission.start.position_W = {0.0, -8.0, 0.0};
  mission.start.heading_rad = M_PI / 2.0;
  mission.goal_W = {0.0, 8.0, 0.0};
  mission.min_W = {-10.0, -10.0, 0.0};
  mission.max_W = {10.0, 10.0, 0.0};
  mission.no_standing = {{Eigen::Vector2d(-50.0, -4.0), Eigen::Vector2d(50.0, 4.0)}};
  return mission;
}

// Two lanes full of fast balls, with gaps.
FakeWorld Road(double phase_s) {
  FakeWorld world;
  for (int i = -8; i < 8; ++i) {
    world.balls.push_back({{i * 28.0 - 9.0 * phase_s, -2.0, 0.0}, {9.0, 0.0, 0.0}, 1.2});
    world.balls.push_back({{i * 28.0 + 9.0 * phase_s, 2.0, 0.0}, {-9.0, 0.0, 0.0}, 1.2});
  }
  return world;
}

// Drives on a map that is always up to date; the least true gap, and the time to the goal.
struct Drive {
  double least_gap_m = INFINITY;
  double reached_s = INFINITY;
  int unsafe = 0;
  std::vector<RobotState> track;
};
Drive RunDrive(const FakeWorld& world, uint64_t seed) {
  const Mission mission = Across();
  const RobotModel robot = Ball();
  double map_time_s = 0.0;
  ClearanceProbe probe(
      [&](const Eigen::Matrix3Xd& points_W, const std::vector<float>& horizons_s) {
        return world.LookupAt(map_time_s)(points_W, horizons_s);
      },
      robot, {}, false, 6.5);
  PilotOptions options;
  options.planner.seed = seed;
  options.latency_s = 0.2;
  Pilot pilot(robot, mission, probe, options);
  Drive drive;
  for (int tick = 0; tick < 100 && drive.reached_s == INFINITY; ++tick) {
    map_time_s = 0.2 * tick;
    Cycle cycle = pilot.Plan(map_time_s, map_time_s);
    EXPECT_FALSE(cycle.blind) << cycle.problem;
    drive.unsafe += !cycle.safe;
    for (double t = map_time_s; t < map_time_s + 0.2; t += 0.01) {
      const RobotState at = pilot.At(t);
      uint32_t object = 0;
      drive.least_gap_m =
          std::min(drive.least_gap_m, world.Distance(at.position_W, t, &object) - 0.5);
      drive.track.push_back(at);
      if ((at.position_W - mission.goal_W).norm() < mission.goal_radius_m) {
        drive.reached_s = std::min(drive.reached_s, t);
      }
    }
  }
  return drive;
}

TEST(Pilot, CrossesARoadThroughGapsAndNeverTouchesAnything) {
  for (uint64_t seed = 0; seed < 3; ++seed) {
    const Drive drive = RunDrive(Road(0.4 * static_cast<double>(seed)), seed);
    EXPECT_GT(drive.least_gap_m, 0.1) << seed;
    EXPECT_LT(drive.reached_s, 16.0) << seed;
  }
}

TEST(Pilot, DrivesTheSameWayAgain) {
  const Drive a = RunDrive(Road(0.3), 5), b = RunDrive(Road(0.3), 5);
  ASSERT_EQ(a.track.size(), b.track.size());
  for (size_t i = 0; i < a.track.size(); ++i) {
    ASSERT_EQ(a.track[i].position_W, b.track[i].position_W) << i;
  }
}

TEST(Pilot, TheDrivenPathNeverJumps) {
  const Drive drive = RunDrive(Road(0.9), 2);
  for (size_t i = 1; i < drive.track.size(); ++i) {
    const double moved_m = (drive.track[i].position_W - drive.track[i - 1].position_W).norm();
    EXPECT_LT(moved_m, 0.01 * 4.0 + 1e-3) << i;
    EXPECT_LT(std::abs(drive.track[i].speed_mps - drive.track[i - 1].speed_mps), 0.01 * 4.0 + 1e-3);
  }
}

TEST(Pilot, AMapThatGrowsOldSlowsItDownAndStopsIt) {
  const Mission mission = Across();
  const RobotModel robot = Ball();
  const FakeWorld empty;
  ClearanceProbe probe(empty.LookupAt(0.0), robot, {}, false, 6.5);
  Pilot pilot(robot, mission, probe, {}), seeing(robot, mission, probe, {});
  for (int tick = 0; tick <= 10; ++tick) {
    pilot.Plan(0.2 * tick, 0.2 * tick);  // fresh up to 2 s
    seeing.Plan(0.2 * tick, 0.2 * tick);
  }
  EXPECT_GT(pilot.At(2.0).speed_mps, 2.0);
  for (int tick = 11; tick <= 40; ++tick) {
    const Cycle cycle = pilot.Plan(0.2 * tick, 2.0);
    EXPECT_EQ(cycle.blind, 0.2 * tick - 2.0 >= 1.0 - 1e-9) << tick;
    if (tick > 14) continue;
    seeing.Plan(0.2 * tick, 0.2 * tick);
  }
  EXPECT_LT(pilot.At(3.0).speed_mps, seeing.At(3.0).speed_mps - 0.5);
  EXPECT_EQ(pilot.At(8.0).speed_mps, 0.0);
  EXPECT_EQ(pilot.At(8.0).position_W, pilot.At(12.0).position_W);
  // And goes on when the map is fresh again.
  for (int tick = 41; tick <= 80; ++tick) pilot.Plan(0.2 * tick, 0.2 * tick);
  EXPECT_LT((pilot.At(16.0).position_W - mission.goal_W).norm(), 0.7);
}

TEST(Pilot, AMapThatCannotBeAskedStopsIt) {
  const Mission mission = Across();
  const RobotModel robot = Ball();
  const FakeWorld empty;
  bool gone = false;
  ClearanceProbe probe(
      [&](const Eigen::Matrix3Xd& points_W,
          const std::vector<float>& horizons_s) -> absl::StatusOr<client::DistanceAnswers> {
        if (gone) return absl::UnavailableError("the server is gone");
        return empty.LookupAt(0.0)(points_W, horizons_s);
      },
      robot, {}, false, 6.5);
  Pilot pilot(robot, mission, probe, {});
  for (int tick = 0; tick <= 10; ++tick) pilot.Plan(0.2 * tick, 0.2 * tick);
  const double moving_mps = pilot.At(2.0).speed_mps;
  EXPECT_GT(moving_mps, 1.0);
  gone = true;
  for (int tick = 11; tick <= 30; ++tick) {
    const Cycle cycle = pilot.Plan(0.2 * tick, 0.2 * tick);
    EXPECT_TRUE(cycle.blind);
    EXPECT_NE(cycle.problem.find("the server is gone"), std::string::npos);
    // From the first blind plan's effect on it brakes and never speeds up.
    if (tick == 11) continue;
    EXPECT_LE(pilot.At(0.2 * tick + 0.2).speed_mps, pilot.At(0.2 * tick).speed_mps + 1e-6);
  }
  EXPECT_EQ(pilot.At(6.0).speed_mps, 0.0);
}

TEST(SpaceTime, OmplsOwnPlannersWorkOnIt) {
  // RRT of OMPL, in the same space with the same validator, around a ball that moves.
  ompl::msg::noOutputHandler();
  ompl::RNG::setSeed(7);
  FakeWorld world;
  world.balls = {{{3.0, -4.0, 0.0}, {0.0, 1.0, 0.0}, 1.0}};
  const RobotModel robot = Ball();
  const auto space = std::make_shared<SpaceTime>(
      robot, SpaceTime::Bounds{{-2.0, -6.0, 0.0}, {10.0, 6.0, 0.0}, 0.0, 20.0});
  const auto si = std::make_shared<ompl::base::SpaceInformation>(space);
  ClearanceProbe probe(world.LookupAt(0.0), robot, {}, false, 20.0);
  si->setStateValidityChecker(std::make_shared<ClearanceStateValidity>(si, probe));
  si->setMotionValidator(std::make_shared<ClearanceMotionValidator>(si, probe));
  si->setup();
  Mission mission;
  mission.goal_W = {7.0, 0.0, 0.0};
  mission.goal_radius_m = 2.0;
  const auto problem = std::make_shared<ompl::base::ProblemDefinition>(si);
  ompl::base::ScopedState<> start(std::static_pointer_cast<ompl::base::StateSpace>(space));
  SpaceTime::Write(mission.start, start.get());
  problem->addStartState(start);
  problem->setGoal(std::make_shared<Destination>(si, mission));
  ompl::geometric::RRT rrt(si);
  rrt.setRange(SpaceTime::kUnreachable);  // whole motions only: states in between are timed apart
  rrt.setProblemDefinition(problem);
  rrt.setup();
  int iterations = 0;
  const auto status =
      rrt.solve(ompl::base::PlannerTerminationCondition([&] { return ++iterations > 20000; }));
  ASSERT_EQ(status, ompl::base::PlannerStatus::EXACT_SOLUTION);
  const auto& states =
      problem->getSolutionPath()->as<ompl::geometric::PathGeometric>()->getStates();
  double last_s = -1.0;
  for (const auto* state : states) {
    EXPECT_GT(SpaceTime::Read(state).time_s, last_s);
    last_s = SpaceTime::Read(state).time_s;
  }
  EXPECT_TRUE(problem->getSolutionPath()->check());
}

}  // namespace
}  // namespace clearance::demo
