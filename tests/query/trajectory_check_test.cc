// Robots along timed paths, against dense sampling of the same query.
#include "server/query/trajectory_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <random>

#include "server/query/point_query.h"
#include "server/query/swept_bounds.h"
#include "tests/query/check_oracle.h"

namespace clearance {
namespace {

using testing::AskState;
using testing::kCheckVoxel_m;
using testing::PathOracle;

const Eigen::Vector3d kCentres[] = {{0, 0, 0}, {-10'000.03, 20'000.07, 31}};

// The field is made once: it takes longer than the checks.
const MapView& YardAt(const Eigen::Vector3d& centre_W) {
  static std::map<double, MapView> yards;
  auto [it, inserted] = yards.try_emplace(centre_W.x());
  if (inserted) it->second = testing::Yard(centre_W, 4, 7);
  return it->second;
}

struct Case {
  const char* name;
  CheckOptions options;
};

std::vector<Case> Cases() {
  std::vector<Case> cases = {{"plain", {}}, {"free", {}}, {"margin", {}}, {"sigma", {}}};
  cases[1].options.unknown_as_occupied = false;
  cases[2].options.margin_m = 0.15;
  cases[2].options.unknown_as_occupied = false;
  cases[3].options.sigma_margin = 2;
  return cases;
}

// Compares one path with its oracle; returns by how much the least clearance is above the oracle's.
double Compare(const MapView& view, const std::vector<RobotSphere>& robot, const RobotPath& path,
               const CheckOptions& options, const PathCheck& check, const PathOracle& oracle) {
  if (oracle.collision_s) {
    EXPECT_TRUE(check.collides) << "missed a collision at " << *oracle.collision_s;
    if (!check.collides) return 0;
    // The oracle's sample may lie behind the true onset by its step, ours by a millisecond's.
    EXPECT_LE(check.first_collision_s, *oracle.collision_s + 1e-3 + 1e-7);
  }
  EXPECT_NEAR(AskState(view, robot, path, check.min_clearance_s, options).clearance_m,
              check.min_clearance_m, 1e-4);
  if (check.collides) {
    // Never without a cause, whatever the oracle's steps passed over.
    EXPECT_TRUE(AskState(view, robot, path, check.first_collision_s, options).collides);
    EXPECT_EQ(check.min_clearance_s, check.first_collision_s);
    EXPECT_EQ(check.last_valid_s.has_value(), check.last_valid_index.has_value());
    if (check.last_valid_s) {
      EXPECT_FALSE(AskState(view, robot, path, *check.last_valid_s, options).collides);
      EXPECT_LE(path.horizons_s[*check.last_valid_index], *check.last_valid_s);
      EXPECT_LT(check.first_collision_s - *check.last_valid_s, 1e-3 + 1e-9);
    }
    return 0;
  }
  EXPECT_EQ(check.last_valid_index, path.T_W_R.size() - 1);
  EXPECT_EQ(check.last_valid_s, path.horizons_s.back());
  const double above_m = check.min_clearance_m - oracle.min_clearance_m;
  EXPECT_LE(above_m, 0.003 + 0.01 * std::abs(oracle.min_distance_m) + 0.5 * kCheckVoxel_m);
  return above_m;
}

TEST(TrajectoryCheck, AgreesWithDenseSamplingInRandomScenes) {
  int collisions = 0, free = 0, initial = 0;
  double worst_m = 0, sum_m = 0;
  for (const Eigen::Vector3d& centre_W : kCentres) {
    const MapView& view = YardAt(centre_W);
    for (const Case& c : Cases()) {
      std::mt19937 rng(11);
      for (int i = 0; i < 40; ++i) {
        SCOPED_TRACE(::testing::Message() << c.name << " " << i << " about " << centre_W.x());
        const auto robot = testing::RandomRobot(rng);
        const RobotPath path = testing::RandomPath(centre_W, rng);
        const PathOracle oracle = testing::SamplePath(view, robot, path, c.options);
        const PathCheck check = CheckPaths(view, robot, {path}, c.options)[0];
        const double above_m = Compare(view, robot, path, c.options, check, oracle);
        worst_m = std::max(worst_m, above_m);
        sum_m += above_m;
        collisions += check.collides;
        initial += check.collides && !check.last_valid_s;
        free += !check.collides;
        if (HasFatalFailure()) return;
      }
    }
  }
  std::printf(
      "%d collide (%d at once), %d free; least clearance above the oracle's: mean %.4f, "
      "max %.4f m\n",
      collisions, initial, free, sum_m / std::max(free, 1), worst_m);
  EXPECT_GT(collisions - initial, 40);
  EXPECT_GT(free, 40);
}

TEST(TrajectoryCheck, NothingIsTunnelledThroughAtAnySpeed) {
  const MapView& view = YardAt({0, 0, 0});
  CheckOptions options;
  options.unknown_as_occupied = false;
  options.layers.static_only = true;
  // A wall of a metre, straight on, and a pole of half a metre, in ever less time.
  for (const double duration_s : {4.0, 0.1, 1e-3, 1e-6}) {
    RobotPath path;
    path.T_W_R.assign(2, Pose::Identity());
    path.T_W_R[0].translation() << -6, 1, 0;
    path.T_W_R[1].translation() << 1, 1, 0;
    path.horizons_s = {0, duration_s};
    PathCheck check = CheckPaths(view, {{{0, 0, 0}, 0.05}}, {path}, options)[0];
    ASSERT_TRUE(check.collides);
    EXPECT_NEAR(check.first_collision_s / duration_s, (6 - 3.7 - 0.05) / 7, 0.02);
    path.T_W_R[0].translation() << 2.2, -5, 0;
    path.T_W_R[1].translation() << 2.0, 2, 0;
    check = CheckPaths(view, {{{0, 0, 0}, 0.01}}, {path}, options)[0];
    ASSERT_TRUE(check.collides);
    EXPECT_NEAR(check.first_collision_s / duration_s, (5 - 1.71 - 0.26) / 7, 0.02);
  }
}

TEST(TrajectoryCheck, ACarThatPassesHitsWhoWaits) {
  MapView view = testing::ViewOf(DistanceField(0.1, 5), 5);
  ObjectView& car = testing::AddObject(view, 9, testing::CarShape(0.1), Pose::Identity());
  car.T_W_L.translation() << -10, 0, 0;
  car.screw_W << 10, 0, 0, 0, 0, 0;
  car.twist.linear_mps << 10, 0, 0;
  view.object_index = BuildObjectIndex(view.objects);
  RobotPath path;
  path.T_W_R.assign(3, Pose::Identity());
  path.T_W_R[0].translation() = path.T_W_R[1].translation() = path.T_W_R[2].translation() =
      Eigen::Vector3d(0, 0, 0.6);
  path.horizons_s = {0, 0.5, 4};
  CheckOptions options;
  options.unknown_as_occupied = false;
  PathCheck check = CheckPaths(view, {{{0, 0, 0}, 0.5}}, {path}, options)[0];
  ASSERT_TRUE(check.collides);
  EXPECT_NEAR(check.first_collision_s, (10 - 2.23 - 0.5) / 10, 0.005);
  EXPECT_EQ(check.last_valid_index, 1u);
  EXPECT_EQ(check.object, 0);
  EXPECT_NEAR(check.twist.linear_mps.x(), 10, 1e-9);
  EXPECT_FALSE(check.unknown_decides);
  // From the side nothing comes near; without it nothing at all.
  for (Pose& T_W_R : path.T_W_R) T_W_R.translation().y() = 3;
  check = CheckPaths(view, {{{0, 0, 0}, 0.5}}, {path}, options)[0];
  EXPECT_FALSE(check.collides);
  EXPECT_NEAR(check.min_clearance_m, 3 - 0.87 - 0.5, 0.06);
  EXPECT_NEAR(check.min_clearance_s, 1.0, 0.3);
  for (Pose& T_W_R : path.T_W_R) T_W_R.translation().y() = 0;
  options.layers.without_objects = {ObjectId(9)};
  check = CheckPaths(view, {{{0, 0, 0}, 0.5}}, {path}, options)[0];
  EXPECT_FALSE(check.collides);
  EXPECT_EQ(check.object, -1);
  // Nobody has seen this place: it is blocked by default.
  options.unknown_as_occupied = true;
  check = CheckPaths(view, {{{0, 0, 0}, 0.5}}, {path}, options)[0];
  EXPECT_TRUE(check.collides);
  EXPECT_TRUE(check.unknown_decides);
  EXPECT_FALSE(check.last_valid_s.has_value());
}

TEST(TrajectoryCheck, UncertaintyGrowsWithTheHorizonWhereAsked) {
  MapView view = testing::ViewOf(DistanceField(0.1, 5), 5);
  ObjectView& car = testing::AddObject(view, 9, testing::CarShape(0.1), Pose::Identity());
  car.velocity_sigma_mps = 0.3;
  view.object_index = BuildObjectIndex(view.objects);
  RobotPath path;
  path.T_W_R.assign(2, Pose::Identity());
  for (Pose& T_W_R : path.T_W_R) T_W_R.translation() << 0, 2.37, 0.6;  // 1.5 m beside it
  path.horizons_s = {0, 4};
  CheckOptions options;
  options.unknown_as_occupied = false;
  EXPECT_FALSE(CheckPaths(view, {{{0, 0, 0}, 0.5}}, {path}, options)[0].collides);
  options.sigma_margin = 2;
  const PathCheck check = CheckPaths(view, {{{0, 0, 0}, 0.5}}, {path}, options)[0];
  ASSERT_TRUE(check.collides);
  EXPECT_NEAR(check.first_collision_s, 1.0 / (2 * 0.3), 0.1);
}

TEST(TrajectoryCheck, PosesAreWhatTheQuerySays) {
  for (const Eigen::Vector3d& centre_W : kCentres) {
    const MapView& view = YardAt(centre_W);
    std::mt19937 rng(3);
    const auto robot = testing::RandomRobot(rng);
    std::vector<Pose> poses;
    std::vector<double> horizons_s;
    for (int i = 0; i < 300; ++i) {
      const RobotPath path = testing::RandomPath(centre_W, rng);
      poses.push_back(path.T_W_R[0]);
      horizons_s.push_back(path.horizons_s[0]);
    }
    for (const Case& c : Cases()) {
      const PoseChecks checks = CheckPoses(view, robot, poses, horizons_s, c.options);
      int collide = 0;
      for (size_t i = 0; i < poses.size(); ++i) {
        const RobotPath still{{poses[i]}, {horizons_s[i]}};
        const auto state = AskState(view, robot, still, horizons_s[i], c.options);
        EXPECT_NEAR(checks.clearances_m[i], state.clearance_m, 1e-5);
        EXPECT_EQ(checks.collides[i] == 1, state.collides);
        EXPECT_LT(checks.sphere_indices[i], robot.size());
        const PathCheck path = CheckPaths(view, robot, {still}, c.options)[0];
        EXPECT_EQ(path.collides, state.collides);
        EXPECT_NEAR(path.min_clearance_m, state.clearance_m, 1e-5);
        collide += checks.collides[i];
      }
      EXPECT_GT(collide, 20) << c.name;
      EXPECT_LT(collide, 300) << c.name;
    }
  }
}

TEST(TrajectoryCheck, ManyPathsInParallelAreTheSameAsOneByOne) {
  const MapView& view = YardAt({0, 0, 0});
  std::mt19937 rng(5);
  const auto robot = testing::RandomRobot(rng);
  std::vector<RobotPath> paths;
  for (int i = 0; i < 100; ++i) paths.push_back(testing::RandomPath({0, 0, 0}, rng));
  const auto together = CheckPaths(view, robot, paths);
  for (size_t i = 0; i < paths.size(); ++i) {
    const PathCheck alone = CheckPaths(view, robot, {paths[i]})[0];
    EXPECT_EQ(together[i].collides, alone.collides);
    EXPECT_EQ(together[i].first_collision_s, alone.first_collision_s);
    EXPECT_EQ(together[i].min_clearance_m, alone.min_clearance_m);
    EXPECT_EQ(together[i].min_clearance_s, alone.min_clearance_s);
  }
}

TEST(SweptBounds, LeastBetweenHoldsForEverySetOutsideBothBalls) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> unit(0, 1);
  int informative = 0;
  for (int i = 0; i < 2000; ++i) {
    const double length = 0.1 + 3 * unit(rng);
    const Eigen::Vector2d a(0, 0), b(length, 0);
    const Eigen::Vector2d obstacle(-1 + (length + 2) * unit(rng), 2 * unit(rng));
    const double d0 = (obstacle - a).norm(), d1 = (obstacle - b).norm();
    const double bound = LeastBetween(d0, d1, length);
    const double x = std::clamp(obstacle.x(), 0.0, length);
    const double truth = std::hypot(obstacle.x() - x, obstacle.y());
    ASSERT_LE(bound, truth + 1e-9);
    // One obstacle alone lies on the circle where both balls meet: the bound is met.
    if (obstacle.x() > 0 && obstacle.x() < length) {
      EXPECT_NEAR(bound, truth, 1e-6);
    }
    informative += bound > 0;
  }
  EXPECT_GT(informative, 1000);
  EXPECT_EQ(LeastBetween(1, 1, 2.1), 0);
  EXPECT_EQ(LeastBetween(-1, 1, 0.5), 0);
}

}  // namespace
}  // namespace clearance
