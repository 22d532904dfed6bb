#include "planner_demo/episode/course.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "planner_demo/episode/judge.h"
#include "planner_demo/episode/truth.h"
#include "planner_demo/plan/pilot.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::demo {
namespace {

constexpr int kFrames = 260;  // scripted motions are free of collisions so long
constexpr double kRoomAtEnds_m = 0.5;

Eigen::AlignedBox2d Strip(double x0, double y0, double x1, double y1) {
  return {Eigen::Vector2d(x0, y0), Eigen::Vector2d(x1, y1)};
}

// Lamps and trees stand where the seed puts them: the nearest place along x that is clear of them.
Eigen::Vector3d ClearOfFurniture(const Course& course, const Eigen::Vector3d& wanted_W) {
  constexpr double kStep_m = 0.25;
  sim::Scene still = course.scene;
  still.movers.clear();
  const auto truth = TruthOf(still);
  const Judge judge(*truth, course.robot, course.mission);
  for (int k = 0; k < 40; ++k) {
    RobotState state;
    state.position_W = wanted_W;
    state.position_W.x() += kStep_m * ((k + 1) / 2) * (k % 2 == 0 ? 1 : -1);
    uint16_t id = 0;
    if (judge.Clearance(state, &id) > kRoomAtEnds_m) return state.position_W;
  }
  return wanted_W;
}

void Finish(Course& course) {
  Mission& mission = course.mission;
  mission.start.position_W = ClearOfFurniture(course, mission.start.position_W);
  mission.goal_W = ClearOfFurniture(course, mission.goal_W);
  const Trajectory straight = StraightAhead(course.robot, course.mission, 0.0);
  course.unobstructed_s = straight.ends_s();
  course.mission.start.heading_rad = straight.states().front().heading_rad;
}

Course Crossing(uint64_t seed, bool drone) {
  Course course;
  course.scene = sim::MakeBusyCrossing(seed, kFrames);
  course.robot = drone ? Drone() : DeliveryRobot();
  course.sensor_R = drone ? Eigen::Vector3d(0.0, 0.0, 0.3) : Eigen::Vector3d(0.0, 0.0, 2.0);
  Mission& mission = course.mission;
  const double z = drone ? 1.3 : 0.15;
  mission.start.position_W = {-9.0, -12.0, z};
  mission.goal_W = {9.0, 12.0, z};
  mission.min_W = {-10.2, -14.0, drone ? 0.8 : z};
  mission.max_W = {10.2, 14.0, drone ? 5.0 : z};
  if (!drone) {
    mission.no_standing = {Strip(-60.0, -4.5, 60.0, 4.5), Strip(-4.5, -60.0, 4.5, 60.0)};
  }
  Finish(course);
  return course;
}

// From pavement to pavement, between the parked cars.
Course Street(uint64_t seed) {
  Course course;
  course.scene = sim::MakeBusyStreet(seed, kFrames);
  course.robot = DeliveryRobot();
  course.sensor_R = Eigen::Vector3d(0.0, 0.0, 2.0);
  Mission& mission = course.mission;
  mission.start.position_W = {4.0, -8.1, 0.15};
  mission.goal_W = {16.0, 8.1, 0.15};
  mission.min_W = {-6.0, -8.6, 0.15};
  mission.max_W = {22.0, 8.6, 0.15};
  mission.no_standing = {Strip(-60.0, -4.2, 60.0, 4.2)};
  Finish(course);
  return course;
}

}  // namespace

std::vector<std::string> CourseNames() { return {"crossing", "street", "drone"}; }

absl::StatusOr<Course> MakeCourse(const std::string& name, uint64_t seed) {
  if (name == "crossing") return Crossing(seed, false);
  if (name == "street") return Street(seed);
  if (name == "drone") return Crossing(seed, true);
  return absl::InvalidArgumentError(
      absl::StrCat("there is no course ", name, "; got: ", absl::StrJoin(CourseNames(), ", ")));
}

Stage StageOf(const Course& course, const SensorRig& rig, const Truth& truth, uint64_t seed) {
  Stage stage;
  stage.name = "demo";
  stage.robot = course.robot;
  stage.mission = course.mission;
  stage.start_s = course.start_s;
  stage.unobstructed_s = course.unobstructed_s;
  stage.ends_s = course.LastChance();
  stage.frame_s = 1.0 / course.scene.rate_hz;
  stage.seed = seed;
  Surround(stage);
  stage.see = [&course, &rig, near_W = stage.static_bounds](
                  uint64_t index, const RobotState& robot,
                  bool labelled) -> absl::StatusOr<std::optional<Frame>> {
    const Eigen::Isometry3d T_W_R = sim::Upright(robot.position_W, robot.heading_rad);
    Frame frame = rig.See(index, T_W_R * Eigen::Translation3d(course.sensor_R), labelled);
    LeaveOutFarStatic(near_W, frame);
    return frame;
  };
  stage.max_range_m = sim::MaxRange(course.scene.sensor);
  stage.truth = &truth;
  return stage;
}

}  // namespace clearance::demo
