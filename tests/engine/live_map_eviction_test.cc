// Forgetting what is far from the sensor, on a map that was really integrated.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <random>

#include "server/engine/live_map.h"
#include "server/map/voxel.h"
#include "server/query/point_query.h"
#include "tests/engine/moving_scene.h"

namespace clearance {
namespace {

constexpr uint8_t kUnknown = 0, kStateMask = 3;

MapConfig Config() {
  MapConfig config;
  config.voxel_size_m = 0.15;
  config.max_distance_m = 2.0;
  return config;
}

void Integrate(LiveMap& map, int from, int to) {
  for (int k = from; k < to; ++k) ASSERT_TRUE(map.Integrate(MovingSceneFrame(k)).ok()) << k;
}

Eigen::Matrix3Xd RandomPoints(int n) {
  std::mt19937 random(23);
  std::uniform_real_distribution<double> x(-7, 7), y(-3, 7), z(-1.6, 3);
  Eigen::Matrix3Xd points(3, n);
  for (int i = 0; i < n; ++i) points.col(i) << x(random), y(random), z(random);
  return points;
}

DistanceBatch AskStatic(LiveMap& map, const Eigen::Matrix3Xd& points) {
  QueryOptions options;
  options.layers.static_only = true;
  return QueryDistances(map.View(), points, options);
}

// Of the block that holds `p`, as the map decides.
double BlockDistance(const Eigen::Vector3d& p, const Eigen::Vector3d& centre) {
  const double block_m = 8 * Config().voxel_size_m;
  const Eigen::Vector3d middle = (((p / block_m).array().floor() + 0.5) * block_m).matrix();
  return (middle - centre).norm();
}

TEST(LiveMapEviction, WhatIsFarBecomesUnknownAndWhatIsNearStays) {
  LiveMap map(Config());
  Integrate(map, 0, 8);
  const Eigen::Matrix3Xd points = RandomPoints(20'000);
  const DistanceBatch before = AskStatic(map, points);
  const auto eviction = map.ChooseEviction(0.5);
  ASSERT_TRUE(eviction);
  const uint64_t revision = map.revision();
  const uint64_t bytes = map.Sizes().memory_bytes;
  map.Evict(*eviction);
  EXPECT_EQ(map.revision(), revision + 1);
  EXPECT_LT(map.Sizes().memory_bytes, bytes);

  const DistanceBatch after = AskStatic(map, points);
  int forgotten = 0, kept = 0;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const auto k = static_cast<size_t>(i);
    const Eigen::Vector3d p = points.col(i);
    const bool was_known = (before.states[k] & kStateMask) != kUnknown;
    if (BlockDistance(p, eviction->centre_W) > eviction->radius_m) {
      EXPECT_EQ(after.states[k] & kStateMask, kUnknown) << p.transpose();
      forgotten += was_known;
    } else {
      EXPECT_EQ(after.states[k] & kStateMask, before.states[k] & kStateMask) << p.transpose();
      kept += was_known;
    }
  }
  EXPECT_GT(forgotten, 100);
  EXPECT_GT(kept, 500);
}

TEST(LiveMapEviction, OnceIsEnoughAndObjectsStay) {
  LiveMap map(Config());
  Integrate(map, 0, 8);
  const size_t objects = map.View().objects.size();
  ASSERT_EQ(objects, 2u);
  const auto eviction = map.ChooseEviction(0.3);
  ASSERT_TRUE(eviction);
  map.Evict(*eviction);
  EXPECT_EQ(map.View().objects.size(), objects);
  const Eigen::Matrix3Xd points = RandomPoints(2000);
  const DistanceBatch once = AskStatic(map, points);
  map.Evict(*eviction);
  const DistanceBatch twice = AskStatic(map, points);
  EXPECT_EQ(once.distances_m, twice.distances_m);
  EXPECT_EQ(once.states, twice.states);
  const auto all = map.ChooseEviction(1.0);
  ASSERT_TRUE(all);
  EXPECT_LE(all->radius_m, eviction->radius_m);
}

TEST(LiveMapEviction, ForgottenSpaceIsMappedAgainWhenItIsSeenAgain) {
  LiveMap map(Config()), fresh(Config());
  Integrate(map, 0, 6);
  map.Evict({Eigen::Vector3d(0, -2, 0.5), 0.0});  // all of it
  const Eigen::Matrix3Xd points = RandomPoints(3000);
  for (const uint8_t state : AskStatic(map, points).states) EXPECT_EQ(state & kStateMask, kUnknown);
  Integrate(map, 6, 12);
  Integrate(fresh, 6, 12);
  const DistanceBatch again = AskStatic(map, points), expected = AskStatic(fresh, points);
  int known = 0, alike = 0;
  for (size_t k = 0; k < again.states.size(); ++k) {
    if ((expected.states[k] & kStateMask) == kUnknown) continue;
    ++known;
    alike += (again.states[k] & kStateMask) == (expected.states[k] & kStateMask) &&
             std::abs(again.distances_m[k] - expected.distances_m[k]) < 0.5 * 0.15;
  }
  EXPECT_GT(known, 300);
  // Objects that were known before free what they leave; the fresh map meets them later.
  EXPECT_GT(alike, 0.95 * known);
}

TEST(LiveMapEviction, TheSameFramesAndEvictionsGiveTheSameBytes) {
  const auto run = [] {
    LiveMap map(Config());
    Integrate(map, 0, 5);
    map.Evict({Eigen::Vector3d(0, -2, 0.5), 4.0});
    Integrate(map, 5, 9);
    std::map<std::string, std::string> files;
    EXPECT_TRUE(map.Freeze()
                    ->Write([&files](std::string_view name, std::string bytes) {
                      if (!name.ends_with(".vdb")) files[std::string(name)] = std::move(bytes);
                      return absl::OkStatus();
                    })
                    .ok());
    return files;
  };
  const auto first = run();
  EXPECT_FALSE(first.empty());
  EXPECT_EQ(first, run());
}

}  // namespace
}  // namespace clearance
