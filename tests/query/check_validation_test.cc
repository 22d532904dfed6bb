// Bad robots and paths: code, field, index, got and limit.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "server/query/trajectory_check.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;

struct Input {
  std::vector<RobotSphere> spheres = {{{0, 0, 0}, 0.5}, {{1, 0, 0}, 0.5}};
  std::vector<RobotPath> paths;
  CheckOptions options;
  CheckLimits limits;
};

Input Good() {
  Input input;
  RobotPath path;
  path.T_W_R.assign(3, Pose::Identity());
  path.horizons_s = {0, 1, 5};
  input.paths.assign(2, path);
  return input;
}

MapView EmptyView() {
  MapView view;
  view.field = DistanceField(0.1, 5);
  view.stamp_ns = 7'000;
  return view;
}

struct BadInput {
  const char* name;
  absl::StatusCode code;
  std::vector<std::string> said;
  std::function<void(Input*)> spoil;
};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kRange = absl::StatusCode::kOutOfRange;

const BadInput kBadInputs[] = {
    {"no spheres", kInvalid, {"spheres", "got 0", "1000"}, [](Input* i) { i->spheres.clear(); }},
    {"thousands of spheres",
     kInvalid,
     {"got 1001", "1000"},
     [](Input* i) {
       i->spheres.assign(1001, {{0, 0, 0}, 1});
     }},
    {"radius zero",
     kInvalid,
     {"spheres[1]", "radius 0"},
     [](Input* i) { i->spheres[1].radius_m = 0; }},
    {"negative radius",
     kInvalid,
     {"spheres[0]", "-0.5"},
     [](Input* i) { i->spheres[0].radius_m = -0.5; }},
    {"radius not a number",
     kInvalid,
     {"spheres[0]"},
     [](Input* i) { i->spheres[0].radius_m = kNan; }},
    {"centre not finite",
     kInvalid,
     {"spheres[1]", "inf"},
     [](Input* i) { i->spheres[1].centre_R.y() = kInf; }},
    {"negative margin", kInvalid, {"margin_m", "-1"}, [](Input* i) { i->options.margin_m = -1; }},
    {"margin not a number", kInvalid, {"margin_m"}, [](Input* i) { i->options.margin_m = kNan; }},
    {"negative sigma margin",
     kInvalid,
     {"sigma_margin"},
     [](Input* i) { i->options.sigma_margin = -1; }},
    {"no paths", kInvalid, {"trajectories", "got 0"}, [](Input* i) { i->paths.clear(); }},
    {"too many paths",
     kInvalid,
     {"trajectories", "got 3", "2"},
     [](Input* i) {
       i->limits.max_paths = 2;
       i->paths.push_back(i->paths[0]);
     }},
    {"an empty path",
     kInvalid,
     {"trajectories[1].waypoints"},
     [](Input* i) { i->paths[1] = RobotPath{}; }},
    {"too many poses",
     kInvalid,
     {"trajectories[1].waypoints", "got 6", "5"},
     [](Input* i) { i->limits.max_poses = 5; }},
    {"times of another length",
     kInvalid,
     {"trajectories[0].times", "got 2", "3"},
     [](Input* i) { i->paths[0].horizons_s.pop_back(); }},
    {"unsorted times",
     kInvalid,
     {"trajectories[0].times[2]", "ascending"},
     [](Input* i) {
       i->paths[0].horizons_s = {0, 2, 1};
     }},
    {"equal times",
     kInvalid,
     {"trajectories[1].times[1]", "ascending"},
     [](Input* i) {
       i->paths[1].horizons_s = {1, 1, 2};
     }},
    {"time not a number",
     kInvalid,
     {"trajectories[0].times[1]"},
     [](Input* i) { i->paths[0].horizons_s[1] = kNan; }},
    {"time before the stamp",
     kRange,
     {"trajectories[0].times[0]", "stamp 7000", "0 to 5"},
     [](Input* i) { i->paths[0].horizons_s[0] = -0.001; }},
    {"time beyond the horizon",
     kRange,
     {"trajectories[1].times[2]", "5.5", "limit 5"},
     [](Input* i) { i->paths[1].horizons_s[2] = 5.5; }},
    {"position not finite",
     kInvalid,
     {"trajectories[0].waypoints[1]", "nan"},
     [](Input* i) { i->paths[0].T_W_R[1].translation().x() = kNan; }},
    {"position beyond all maps",
     kInvalid,
     {"trajectories[0].waypoints[2]", "1e+12"},
     [](Input* i) { i->paths[0].T_W_R[2].translation().x() = 1e12; }},
    {"too many states", kInvalid, {"got 12", "11"}, [](Input* i) { i->limits.max_states = 11; }},
    {"too long a way",
     kInvalid,
     {"got 40 m", "30"},
     [](Input* i) {
       i->limits.max_travel_m = 30;
       i->paths[0].T_W_R[2].translation().z() = 20;
     }},
    {"unknown object",
     absl::StatusCode::kNotFound,
     {"layers.only_objects[0]", "no object 4"},
     [](Input* i) { i->options.layers.only_objects = {ObjectId(4)}; }},
    {"layers that exclude each other",
     kInvalid,
     {"layers"},
     [](Input* i) {
       i->options.layers.static_only = true;
       i->options.layers.only_objects = {ObjectId(4)};
     }},
};

TEST(CheckValidation, EveryBadInputSaysWhatIsWrong) {
  const MapView view = EmptyView();
  const Input good = Good();
  ASSERT_TRUE(ValidateCheck(view, good.spheres, good.paths, good.options).ok());
  for (const BadInput& bad : kBadInputs) {
    SCOPED_TRACE(bad.name);
    Input input = Good();
    bad.spoil(&input);
    const absl::Status status =
        ValidateCheck(view, input.spheres, input.paths, input.options, input.limits);
    EXPECT_EQ(status.code(), bad.code) << status;
    for (const std::string& part : bad.said) {
      EXPECT_THAT(std::string(status.message()), HasSubstr(part));
    }
  }
}

TEST(CheckValidation, PosesNeedATimeEachOrNone) {
  const MapView view = EmptyView();
  const std::vector<RobotSphere> robot = {{{0, 0, 0}, 0.5}};
  const std::vector<Pose> poses(3, Pose::Identity());
  EXPECT_TRUE(ValidateCheck(view, robot, poses, {}, {}).ok());
  EXPECT_TRUE(ValidateCheck(view, robot, poses, {3, 1, 2}, {}).ok());
  EXPECT_EQ(ValidateCheck(view, robot, poses, {1, 2}, {}).code(), kInvalid);
  EXPECT_EQ(ValidateCheck(view, robot, poses, {1, 2, -1}, {}).code(), kRange);
  EXPECT_EQ(ValidateCheck(view, robot, poses, {1, 2, 9}, {}).code(), kRange);
  EXPECT_EQ(ValidateCheck(view, robot, std::vector<Pose>{}, {}, {}).code(), kInvalid);
}

}  // namespace
}  // namespace clearance
