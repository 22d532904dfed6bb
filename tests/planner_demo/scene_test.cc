#include "planner_demo/sim/scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "planner_demo/sim/mesh.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::sim {
namespace {

TEST(Path, FollowsStraightsAndArcsAtAScriptedSpeed) {
  Path path;
  path.start_W = {1.0, 2.0, 0.5};
  path.start_heading_rad = std::numbers::pi / 2.0;
  path.stretches = {{10.0, 0.0}, {5.0 * std::numbers::pi / 2.0, -0.2}};
  path.speeds = {{1.0, 4.0}, {3.0, 8.0}};
  EXPECT_DOUBLE_EQ(path.ArcLengthAt(0.0), 0.0);
  EXPECT_DOUBLE_EQ(path.ArcLengthAt(1.0), 4.0);
  EXPECT_DOUBLE_EQ(path.ArcLengthAt(3.0), 16.0);
  EXPECT_DOUBLE_EQ(path.ArcLengthAt(4.0), 24.0);
  EXPECT_DOUBLE_EQ(path.ArcLengthAt(-1.0), -4.0);
  // North for 10 m, then a quarter turn to the right with radius 5, then east.
  const Eigen::Isometry3d end = path.PoseAtArcLength(10.0 + 2.5 * std::numbers::pi + 3.0);
  EXPECT_TRUE(end.translation().isApprox(Eigen::Vector3d(1.0 + 5.0 + 3.0, 2.0 + 15.0, 0.5), 1e-12));
  EXPECT_TRUE((end.linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitX(), 1e-9));
  EXPECT_TRUE(path.PoseAtArcLength(-2.0).translation().isApprox(Eigen::Vector3d(1.0, 0.0, 0.5)));
}

TEST(Path, MovesAsFastAsItSays) {
  Path path;
  path.stretches = {{3.0, 0.3}, {4.0, -0.5}, {2.0, 0.0}};
  path.speeds = {{-2.0, 1.0}, {0.5, 3.0}, {2.0, 0.0}, {3.0, 2.0}};
  constexpr double kStep = 1e-4;
  for (double t = -3.0; t < 5.0; t += 0.0371) {
    const double moved =
        (path.PoseAt(t + kStep).translation() - path.PoseAt(t - kStep).translation()).norm();
    const double ahead = (path.ArcLengthAt(t + kStep) - path.ArcLengthAt(t - kStep));
    EXPECT_NEAR(moved, ahead, 1e-7);
    EXPECT_GE(ahead, 0.0);
  }
}

class EveryScene : public testing::TestWithParam<std::string> {};

TEST_P(EveryScene, IsTheSameForTheSameSeedAndAnotherForAnother) {
  const auto a = MakeScene(GetParam(), 3);
  const auto b = MakeScene(GetParam(), 3);
  const auto c = MakeScene(GetParam(), 4);
  ASSERT_TRUE(a && b && c);
  EXPECT_EQ(a->name, GetParam());
  ASSERT_EQ(a->movers.size(), b->movers.size());
  bool differs = a->movers.size() != c->movers.size();
  for (const double t : {-1.0, 0.0, 1.37, 20.0}) {
    EXPECT_EQ(a->T_W_X(t).matrix(), b->T_W_X(t).matrix());
    differs = differs || a->T_W_X(t).matrix() != c->T_W_X(t).matrix();
    for (size_t i = 0; i < a->movers.size(); ++i) {
      EXPECT_EQ(a->movers[i].id, b->movers[i].id);
      EXPECT_EQ(a->movers[i].T_W_L(t).matrix(), b->movers[i].T_W_L(t).matrix());
      differs = differs || (i < c->movers.size() &&
                            a->movers[i].T_W_L(t).matrix() != c->movers[i].T_W_L(t).matrix());
    }
  }
  EXPECT_TRUE(differs);
}

TEST_P(EveryScene, KeepsItsSensorInTheOpenAndItsMoversApart) {
  for (const uint64_t seed : {0u, 7u}) {
    const auto scene = MakeScene(GetParam(), seed);
    const int frames = scene->frame_count + scene->future_frames;
    for (int k = 0; k < frames; k += 7) {
      const double t = k / scene->rate_hz;
      if (k < scene->frame_count) {
        EXPECT_GT(TrueDistance(*scene, scene->T_W_X(t).translation(), t), 0.4);
      }
      for (size_t i = 0; i < scene->movers.size(); ++i) {
        // The corners of each part, above the kerbs: outside of everything but the mover itself.
        const Mover& mover = scene->movers[i];
        Scene others = *scene;
        others.movers.erase(others.movers.begin() + i);
        for (const Solid& solid : mover.solids) {
          const Eigen::Vector3d centre_W = mover.T_W_L(t) * Bounds(solid).center();
          if (centre_W.z() < 0.3) continue;
          EXPECT_GT(TrueDistance(others, centre_W, t), 0.1) << "mover " << mover.id << " at " << t;
        }
      }
    }
  }
}

TEST_P(EveryScene, HasTheMoversItPromises) {
  const std::map<std::string, size_t> expected = {{"crossing", 12}, {"street", 5}, {"orbit", 1},
                                                  {"cubes", 4},     {"hall", 12},  {"parking", 3}};
  for (const uint64_t seed : {0u, 1u, 2u, 3u}) {
    const auto scene = MakeScene(GetParam(), seed);
    const auto it = expected.find(GetParam());
    if (scene->name.starts_with("busy")) {
      EXPECT_GT(scene->movers.size(), 12u) << "seed " << seed;
    } else {
      EXPECT_EQ(scene->movers.size(), it == expected.end() ? 0u : it->second) << "seed " << seed;
    }
    for (size_t i = 0; i < scene->movers.size(); ++i) EXPECT_EQ(scene->movers[i].id, i + 1);
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, EveryScene, testing::ValuesIn(SceneNames()),
                         [](const auto& info) { return info.param; });

TEST(MakeScene, KnowsNoOtherNames) { EXPECT_FALSE(MakeScene("nowhere", 0).has_value()); }

TEST(TrueDistance, NamesTheMoverThatDecides) {
  Scene scene;
  scene.static_solids = {MakeBox({-10.0, -10.0, -1.0}, {10.0, 10.0, 0.0})};
  scene.movers.push_back({5, "Ball", {MakeSphere({0.0, 0.0, 0.0}, 0.5)}, [](double t) {
                            return Upright({t, 0.0, 3.0}, 0.0);
                          }});
  int mover = 7;
  EXPECT_DOUBLE_EQ(TrueDistance(scene, {0.0, 0.0, 1.0}, 0.0, &mover), 1.0);
  EXPECT_EQ(mover, -1);
  EXPECT_DOUBLE_EQ(TrueDistance(scene, {2.0, 0.0, 2.25}, 2.0, &mover), 0.25);
  EXPECT_EQ(mover, 0);
  EXPECT_DOUBLE_EQ(TrueDistance(scene, {2.0, 0.0, 2.75}, 2.0), -0.25);
}

}  // namespace
}  // namespace clearance::sim
