// A scene, a robot, and what it has to do there.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "planner_demo/episode/episode.h"
#include "planner_demo/episode/sensor_rig.h"
#include "planner_demo/plan/mission.h"
#include "planner_demo/sim/scene.h"

namespace clearance::demo {

struct Course {
  sim::Scene scene;  // its own sensor pose is not used
  RobotModel robot;
  Mission mission;
  Eigen::Vector3d sensor_R = Eigen::Vector3d::Zero();  // where the robot carries its lidar
  double start_s = 1.0;                                // looks around until then
  double unobstructed_s = 0.0;                         // the straight line at full speed
  double LastChance() const { return start_s + 2.0 * unobstructed_s; }
};

// crossing: over a busy crossing from corner to opposite corner; street: over a busy street between
// parked cars; drone: over the crossing through the air. INVALID_ARGUMENT for other names.
std::vector<std::string> CourseNames();
absl::StatusOr<Course> MakeCourse(const std::string& name, uint64_t seed);

// The stage of one drive on a course; all must outlive it.
Stage StageOf(const Course& course, const SensorRig& rig, const Truth& truth, uint64_t seed);

}  // namespace clearance::demo
