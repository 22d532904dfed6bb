#include "planner_demo/plan/space_time.h"

#include <gtest/gtest.h>
#include <ompl/base/ScopedState.h>

#include <cmath>

#include "planner_demo/sim/random.h"

namespace clearance::demo {
namespace {

SpaceTime::Bounds Wide() { return {{-500, -500, -5}, {500, 500, 5}, -100, 100}; }

RobotState RandomState(sim::Random& random, const RobotModel& robot, double around_m) {
  RobotState state;
  state.position_W = {random.Uniform(-around_m, around_m) - 200.0,
                      random.Uniform(-around_m, around_m) + 100.0, random.Uniform(-1.0, 1.0)};
  state.heading_rad = random.Uniform(-M_PI, M_PI);
  state.speed_mps = random.Uniform(0.0, robot.max_speed_mps);
  state.time_s = random.Uniform(0.0, 10.0);
  return state;
}

TEST(SpaceTime, WhatItCallsFeasibleKeepsEveryLimit) {
  RobotModel robot = Drone();
  const SpaceTime space(robot, Wide());
  sim::Random random(3);
  int feasible = 0;
  for (int i = 0; i < 6000; ++i) {
    const RobotState from = RandomState(random, robot, 8.0);
    const RobotState to = RandomState(random, robot, 8.0);
    const Steering steering = space.Steer(from, to);
    if (to.time_s <= from.time_s) {
      EXPECT_FALSE(steering.feasible);
      continue;
    }
    if (!steering.feasible) continue;
    ++feasible;
    constexpr double kStep_s = 4e-3;
    RobotState last = from;
    for (double t = kStep_s; t <= steering.duration_s; t += kStep_s) {
      const RobotState now = space.Along(from, to, steering, t);
      EXPECT_GT(now.time_s, last.time_s);
      EXPECT_LE(now.speed_mps, robot.max_speed_mps + 1e-6);
      EXPECT_GE(now.speed_mps, -1e-6);
      const double accel = (now.speed_mps - last.speed_mps) / kStep_s;
      EXPECT_LE(accel, robot.max_accel_mps2 + 1e-3);
      EXPECT_GE(accel, -robot.max_brake_mps2 - 1e-3);
      // It moves as fast as it says (but for the bend of its speed halfway), and turns no tighter
      // than it can.
      const double moved_m = (now.position_W - last.position_W).norm();
      EXPECT_LE(moved_m, kStep_s * 0.5 * (now.speed_mps + last.speed_mps) + 5e-5);
      const double turned = std::abs(std::remainder(now.heading_rad - last.heading_rad, 2 * M_PI));
      EXPECT_LE(turned, (moved_m + 1e-6) / robot.turn_radius_m * 1.01 + 1e-6);
      last = now;
    }
    const RobotState end = space.Along(from, to, steering, steering.duration_s);
    EXPECT_LT((end.position_W - to.position_W).norm(), 1e-6);
    EXPECT_NEAR(std::remainder(end.heading_rad - to.heading_rad, 2 * M_PI), 0.0, 1e-6);
    EXPECT_NEAR(end.speed_mps, to.speed_mps, 1e-9);
  }
  EXPECT_GT(feasible, 50);
}

TEST(SpaceTime, TellsWhatIsTooFastFromWhatIsNot) {
  RobotModel robot = DeliveryRobot();
  const SpaceTime space(robot, Wide());
  RobotState from, to;
  to.position_W.x() = 10.0;
  // From rest to rest over 10 m with 2 m/s^2 up and down: two halves of sqrt(5) s.
  to.time_s = 2.0 * std::sqrt(5.0) + 1e-4;
  EXPECT_FALSE(space.Steer(from, to).feasible);  // needs 4.47 m/s in the middle
  to.time_s = 5.01;
  EXPECT_TRUE(space.Steer(from, to).feasible);
  EXPECT_NEAR(space.Steer(from, to).middle_mps, 2.0 * 10.0 / 5.01, 1e-9);
  to.time_s = -5.01;
  EXPECT_FALSE(space.Steer(from, to).feasible);
  // At rest it may wait and turn about itself at 2 rad/s.
  to = from;
  to.time_s = 1.0;
  to.heading_rad = 1.9;
  EXPECT_TRUE(space.Steer(from, to).feasible);
  to.heading_rad = 2.1;
  EXPECT_FALSE(space.Steer(from, to).feasible);
  // What drives does not climb.
  to = from;
  to.position_W = {10.0, 0.0, 0.5};
  to.time_s = 6.0;
  EXPECT_FALSE(space.Steer(from, to).feasible);
}

TEST(SpaceTime, DistancesOfStatesOutOfReachExceedAllOthers) {
  const RobotModel robot = DeliveryRobot();
  const SpaceTime space(robot, Wide());
  ompl::base::StateSpacePtr shared = std::make_shared<SpaceTime>(robot, Wide());
  ompl::base::ScopedState<> a(shared), b(shared);
  sim::Random random(4);
  for (int i = 0; i < 2000; ++i) {
    RobotState from = RandomState(random, robot, 5.0), to = RandomState(random, robot, 5.0);
    from.position_W.z() = to.position_W.z() = 0.0;
    SpaceTime::Write(from, a.get());
    SpaceTime::Write(to, b.get());
    const double distance = shared->distance(a.get(), b.get());
    if (space.Steer(from, to).feasible) {
      EXPECT_NEAR(distance, to.time_s - from.time_s, 1e-9);
    } else {
      EXPECT_GE(distance, SpaceTime::kUnreachable);
    }
    const RobotState again = SpaceTime::Read(a.get());
    EXPECT_EQ(again.position_W, from.position_W);
    EXPECT_EQ(again.time_s, from.time_s);
  }
}

TEST(Trajectory, RestsBeforeAndBehindItsTime) {
  RobotModel robot = DeliveryRobot();
  const auto space = std::make_shared<SpaceTime>(robot, Wide());
  RobotState from, to;
  from.time_s = 2.0;
  to.position_W.x() = 3.0;
  to.time_s = 6.0;
  const Trajectory trajectory(space, {from, to});
  EXPECT_EQ(trajectory.At(1.0).speed_mps, 0.0);
  EXPECT_EQ(trajectory.At(1.0).position_W.x(), 0.0);
  EXPECT_NEAR(trajectory.At(4.0).position_W.x(), 1.5, 1e-6);
  EXPECT_NEAR(trajectory.At(4.0).speed_mps, 1.5, 1e-6);
  EXPECT_EQ(trajectory.At(9.0).position_W.x(), 3.0);
  EXPECT_EQ(trajectory.At(9.0).time_s, 9.0);
}

}  // namespace
}  // namespace clearance::demo
