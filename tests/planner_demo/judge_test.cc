#include "planner_demo/episode/judge.h"

#include <gtest/gtest.h>

#include <cmath>

#include "planner_demo/episode/course.h"
#include "planner_demo/episode/sensor_rig.h"
#include "planner_demo/plan/pilot.h"
#include "planner_demo/sim/motion.h"

namespace clearance::demo {
namespace {

// A ball of 1 m radius that passes x = 10 at y = 5 t - 20, 0.7 m above the ground.
sim::Scene OneBall(double z) {
  sim::Scene scene;
  scene.static_solids = {sim::MakeBox({-50.0, -50.0, -1.0}, {50.0, 50.0, 0.0}),
                         sim::MakeBox({30.0, -50.0, 0.0}, {31.0, 50.0, 5.0})};
  scene.movers.push_back({3, "Ball", {sim::MakeSphere({0.0, 0.0, 0.0}, 1.0)}, [z](double t) {
                            return sim::Upright({10.0, 5.0 * t - 20.0, z}, 0.0);
                          }});
  return scene;
}

RobotModel OneSphere() {
  RobotModel robot;
  robot.spheres = {{{0.0, 0.0, 0.7}, 0.5}};
  return robot;
}

RobotState AtX(double x, double speed, double t) {
  RobotState state;
  state.position_W = {x, 0.0, 0.0};
  state.speed_mps = speed;
  state.time_s = t;
  return state;
}

TEST(Judge, MeasuresTheLeastClearanceOfAPass) {
  const auto truth = TruthOf(OneBall(0.7));
  const RobotModel robot = OneSphere();
  const Mission mission;
  Judge judge(*truth, robot, mission);
  // Stands at x = 12.5: 2.5 - 1 - 0.5 = 1 m when the ball passes at 4 s.
  judge.Advance([](double t) { return AtX(12.5, 0.0, t); }, 0.0, 8.0);
  EXPECT_FALSE(judge.verdict().collision.has_value());
  EXPECT_NEAR(judge.verdict().min_clearance_m, 1.0, 1e-3);
  EXPECT_NEAR(judge.verdict().min_clearance_at_s, 4.0, 0.05);
}

TEST(Judge, FindsTheMomentOfACollision) {
  const auto truth = TruthOf(OneBall(0.7));
  const RobotModel robot = OneSphere();
  const Mission mission;
  Judge judge(*truth, robot, mission);
  // Both on their way to (10, 0) at 4 s: sqrt((2 s)^2 + (5 s)^2) = 1.5 m, s before that.
  judge.Advance([](double t) { return AtX(2.0 + 2.0 * t, 2.0, t); }, 0.0, 8.0);
  ASSERT_TRUE(judge.verdict().collision.has_value());
  EXPECT_NEAR(judge.verdict().collision->time_s, 4.0 - 1.5 / std::sqrt(29.0), 2e-3);
  EXPECT_EQ(judge.verdict().collision->object_id, 3);
  EXPECT_TRUE(judge.verdict().collision->caused);
}

TEST(Judge, TellsWhoIsToBlame) {
  const auto truth = TruthOf(OneBall(0.7));
  const RobotModel robot = OneSphere();
  Mission mission;
  // Stands there all along, where it may.
  Judge innocent(*truth, robot, mission);
  innocent.Advance([](double t) { return AtX(10.0, 0.0, t); }, 0.0, 8.0);
  ASSERT_TRUE(innocent.verdict().collision.has_value());
  EXPECT_FALSE(innocent.verdict().collision->caused);
  // Comes to rest there half a second before.
  Judge late(*truth, robot, mission);
  late.Advance([](double t) { return t < 3.2 ? AtX(10.0, 1.0, t) : AtX(10.0, 0.0, t); }, 0.0, 8.0);
  ASSERT_TRUE(late.verdict().collision.has_value());
  EXPECT_TRUE(late.verdict().collision->caused);
  // Stands on a carriageway.
  mission.no_standing = {{Eigen::Vector2d(5.0, -50.0), Eigen::Vector2d(15.0, 50.0)}};
  Judge parked(*truth, robot, mission);
  parked.Advance([](double t) { return AtX(10.0, 0.0, t); }, 0.0, 8.0);
  ASSERT_TRUE(parked.verdict().collision.has_value());
  EXPECT_TRUE(parked.verdict().collision->caused);
  EXPECT_NE(parked.verdict().collision->cause.find("carriageway"), std::string::npos);
}

TEST(Judge, WallsCountAndTheGroundDoesNot) {
  const auto truth = TruthOf(OneBall(50.0));
  const RobotModel robot = OneSphere();
  Mission mission;
  mission.goal_W = {29.3, 0.0, 0.0};
  Judge judge(*truth, robot, mission);
  judge.Advance([](double t) { return AtX(20.0 + t, 1.0, t); }, 0.0, 20.0);
  ASSERT_TRUE(judge.verdict().collision.has_value());
  EXPECT_EQ(judge.verdict().collision->object_id, 0);
  EXPECT_NEAR(judge.verdict().collision->time_s, 9.5, 2e-3);
  EXPECT_FALSE(judge.verdict().reached_s.has_value());  // passed, never at rest
}

TEST(Judge, ArrivesWhenAtRestNearTheGoal) {
  const auto truth = TruthOf(OneBall(50.0));
  const RobotModel robot = OneSphere();
  Mission mission;
  mission.goal_W = {5.0, 0.0, 0.0};
  Judge judge(*truth, robot, mission);
  const auto drive = [](double t) { return t < 5.0 ? AtX(t, 1.0, t) : AtX(5.0, 0.0, t); };
  judge.Advance(drive, 0.0, 4.0);
  EXPECT_FALSE(judge.verdict().reached_s.has_value());
  judge.Advance(drive, 4.0, 7.0);
  ASSERT_TRUE(judge.verdict().reached_s.has_value());
  EXPECT_NEAR(*judge.verdict().reached_s, 5.0, 0.03);
}

TEST(Course, IsTheSameForTheSameSeedAndItsFramesAreToo) {
  for (const std::string& name : CourseNames()) {
    const auto a = MakeCourse(name, 4), b = MakeCourse(name, 4), c = MakeCourse(name, 5);
    ASSERT_TRUE(a.ok() && b.ok() && c.ok());
    const SensorRig rig_a(a->scene, {}, 4), rig_b(b->scene, {}, 4), rig_c(c->scene, {}, 5);
    const Eigen::Isometry3d T_W_X = sim::Upright({-9.0, -12.0, 2.0}, 0.3);
    const Frame fa = rig_a.See(20, T_W_X, true), fb = rig_b.See(20, T_W_X, true);
    const auto& points_a = std::get<PointCloud>(fa.observation).points_X;
    EXPECT_EQ(points_a, std::get<PointCloud>(fb.observation).points_X);
    EXPECT_NE(points_a, std::get<PointCloud>(rig_c.See(20, T_W_X, true).observation).points_X);
    ASSERT_EQ(fa.motions.size(), fb.motions.size());
    for (size_t i = 0; i < fa.motions.size(); ++i) {
      EXPECT_EQ(fa.motions[i].pose.matrix(), fb.motions[i].pose.matrix());
    }
    EXPECT_TRUE(rig_a.See(20, T_W_X, false).motions.empty());
    const auto unlabelled = rig_a.See(20, T_W_X, false);
    for (const uint16_t label : std::get<PointCloud>(unlabelled.observation).labels) {
      ASSERT_EQ(label, 0);
    }
  }
  EXPECT_FALSE(MakeCourse("nowhere", 0).ok());
}

TEST(Course, StartAndGoalAreClearWhileTheRobotStandsThere) {
  for (const std::string& name : CourseNames()) {
    for (uint64_t seed = 0; seed < 5; ++seed) {
      const auto course = MakeCourse(name, seed);
      const auto truth = TruthOf(course->scene);
      Judge judge(*truth, course->robot, course->mission);
      RobotState state = course->mission.start;
      uint16_t id = 0;
      EXPECT_GT(judge.Clearance(state, &id), 0.3) << name << seed;
      state.position_W = course->mission.goal_W;
      Eigen::Vector3d goal = state.position_W;
      // Static surroundings of the goal; traffic passes when it likes.
      sim::Scene still = course->scene;
      still.movers.clear();
      const auto surroundings = TruthOf(still);
      EXPECT_GT(surroundings->Distance(goal + course->robot.spheres[0].center_R, 0.0, &id),
                course->robot.spheres[0].radius_m + 0.3)
          << name << seed;
    }
  }
}

}  // namespace
}  // namespace clearance::demo
