#include "planner_demo/sim/simulator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::sim {
namespace {

// A small crossing: fewer rays, the same world.
Scene SmallCrossing(uint64_t seed) {
  Scene scene = MakeCrossing(seed, 20);
  scene.sensor = Lidar{16, 120, -0.3, 0.3, 40.0};
  return scene;
}

TEST(Simulator, PlaysTheSameFramesAgain) {
  NoiseOptions noise;
  noise.depth_sigma_m = 0.02;
  noise.motion_sigma_m = 0.01;
  noise.label_shrink_px = 1;
  Simulator a(SmallCrossing(2), noise, 9);
  Simulator b(SmallCrossing(2), noise, 9);
  Simulator other(SmallCrossing(2), noise, 10);
  for (int k = 0; k < 5; ++k) {
    const SimulatedFrame fa = a.Next();
    const SimulatedFrame fb = b.Next();
    EXPECT_EQ(fa.scan.ranges_m, fb.scan.ranges_m);
    EXPECT_EQ(fa.scan.labels, fb.scan.labels);
    ASSERT_EQ(fa.motions.size(), fb.motions.size());
    for (size_t i = 0; i < fa.motions.size(); ++i) {
      EXPECT_EQ(fa.motions[i].H_W.matrix(), fb.motions[i].H_W.matrix());
    }
    EXPECT_NE(fa.scan.ranges_m, other.Next().scan.ranges_m);
  }
}

TEST(Simulator, LabelsEveryReturnWithTheBodyItLiesOn) {
  const Scene scene = SmallCrossing(1);
  Simulator simulator(scene, {}, 0);
  const std::vector<Eigen::Vector3d> directions = RayDirections(scene.sensor);
  int on_movers = 0;
  for (int k = 0; k < 20; ++k) {
    const SimulatedFrame frame = simulator.Next();
    std::map<uint16_t, int> pixels;
    for (size_t i = 0; i < directions.size(); ++i) {
      if (frame.scan.ranges_m[i] == 0.0) {
        EXPECT_EQ(frame.scan.labels[i], 0);
        continue;
      }
      const Eigen::Vector3d point_W = frame.T_W_X * (frame.scan.ranges_m[i] * directions[i]);
      const uint16_t label = frame.scan.labels[i];
      if (label == 0) {
        EXPECT_NEAR(SignedDistance(scene.static_solids, point_W), 0.0, 1e-8);
      } else {
        ++pixels[label];
        ++on_movers;
        const Mover& mover = scene.movers[label - 1];
        EXPECT_NEAR(SignedDistance(mover.solids, mover.T_W_L(frame.time_s).inverse() * point_W),
                    0.0, 1e-8);
      }
    }
    EXPECT_EQ(pixels, frame.true_pixels);
  }
  EXPECT_GT(on_movers, 100);
}

TEST(Simulator, ReportsMotionsOfWhatItHasLabelledThatChainToTheTruePoses) {
  const Scene scene = SmallCrossing(3);
  Simulator simulator(scene, {}, 0);
  std::map<uint16_t, Eigen::Isometry3d> T_W_L;  // of the movers labelled so far
  for (int k = 0; k < 60; ++k) {
    const SimulatedFrame frame = simulator.Next();
    ASSERT_EQ(frame.motions.size(), T_W_L.size());
    for (const SimulatedFrame::Motion& motion : frame.motions) {
      Eigen::Isometry3d& pose = T_W_L.at(motion.object_id);
      pose = motion.H_W * pose;
      EXPECT_TRUE(pose.isApprox(scene.movers[motion.object_id - 1].T_W_L(frame.time_s), 1e-9));
    }
    for (const auto& [id, pixels] : frame.true_pixels) {
      T_W_L.try_emplace(id, scene.movers[id - 1].T_W_L(frame.time_s));
    }
  }
  EXPECT_GT(T_W_L.size(), 5u);
  EXPECT_LT(T_W_L.size(), scene.movers.size());
}

TEST(Noise, ShiftsAMotionAboutTheObjectByItsStandardDeviation) {
  const Eigen::Vector3d centre_W(1e4, -2e4, 3.0);
  double sum2 = 0.0;
  constexpr int kDraws = 4000;
  for (int k = 0; k < kDraws; ++k) {
    const Eigen::Isometry3d H_W =
        AddMotionNoise(Eigen::Isometry3d::Identity(), centre_W, 0.05, 1, 2, k);
    sum2 += (H_W * centre_W - centre_W).squaredNorm() / 3.0;
  }
  EXPECT_NEAR(std::sqrt(sum2 / kDraws), 0.05, 0.002);
}

Scan Picture(int rows, int columns, const std::vector<uint16_t>& labels) {
  return {rows, columns, std::vector<double>(labels.size(), 1.0), labels};
}

TEST(Noise, ShrinksLabelsAtEveryBorder) {
  Scan scan = Picture(3, 7, {0, 1, 1, 1, 1, 1, 2,  //
                             0, 1, 1, 1, 1, 1, 2,  //
                             0, 1, 1, 1, 1, 1, 2});
  Scan ring = scan;
  ShrinkLabels(1, false, scan);
  EXPECT_EQ(scan.labels, (std::vector<uint16_t>{0, 0, 1, 1, 1, 0, 0,  //
                                                0, 0, 1, 1, 1, 0, 0,  //
                                                0, 0, 1, 1, 1, 0, 0}));
  ShrinkLabels(2, true, ring);
  EXPECT_EQ(ring.labels, (std::vector<uint16_t>{0, 0, 0, 1, 0, 0, 0,  //
                                                0, 0, 0, 1, 0, 0, 0,  //
                                                0, 0, 0, 1, 0, 0, 0}));
}

TEST(Noise, GrowsLabelsOverReturnsOnly) {
  Scan scan = Picture(1, 8, {0, 0, 3, 0, 2, 0, 0, 0});
  scan.ranges_m[5] = 0.0;
  Scan ring = Picture(1, 4, {5, 0, 0, 0});
  GrowLabels(1, false, scan);
  EXPECT_EQ(scan.labels, (std::vector<uint16_t>{0, 3, 3, 2, 2, 0, 0, 0}));
  GrowLabels(1, true, ring);
  EXPECT_EQ(ring.labels, (std::vector<uint16_t>{5, 5, 0, 5}));
}

TEST(Noise, AddsDepthErrorsOfItsStandardDeviationAndLosesWhatLeavesTheRange) {
  Scan scan{100, 100, std::vector<double>(10000, 5.0), std::vector<uint16_t>(10000, 1)};
  scan.ranges_m[0] = 0.0;
  Scan near_limit = scan;
  AddDepthNoise(0.1, 10.0, 3, 0, scan);
  double sum = 0.0;
  double sum2 = 0.0;
  for (size_t i = 1; i < scan.ranges_m.size(); ++i) {
    sum += scan.ranges_m[i] - 5.0;
    sum2 += std::pow(scan.ranges_m[i] - 5.0, 2);
  }
  EXPECT_EQ(scan.ranges_m[0], 0.0);
  EXPECT_NEAR(sum / 9999.0, 0.0, 0.005);
  EXPECT_NEAR(std::sqrt(sum2 / 9999.0), 0.1, 0.003);
  AddDepthNoise(0.1, 5.0, 3, 0, near_limit);
  int lost = 0;
  for (size_t i = 1; i < near_limit.ranges_m.size(); ++i) {
    EXPECT_LE(near_limit.ranges_m[i], 5.0);
    if (near_limit.ranges_m[i] > 0.0) continue;
    ++lost;
    EXPECT_EQ(near_limit.labels[i], 0);
  }
  EXPECT_NEAR(lost, 5000, 300);
}

TEST(Noise, HidesAnObjectInItsFirstFramesInViewAndItsMotionsWithIt) {
  Scene scene;
  scene.static_solids = {MakeBox({-50.0, -50.0, -1.0}, {50.0, 50.0, 0.0})};
  scene.movers.push_back({1, "Ball", {MakeSphere({0.0, 0.0, 0.0}, 0.8)}, [](double t) {
                            return Upright({4.0, 2.0 * t - 8.0, 1.0}, 0.0);
                          }});
  scene.sensor = DepthCamera::WithHorizontalView(80, 40, 1.2, 1e-3, 20.0);
  scene.T_W_X = [](double) { return LookAt({0.0, 0.0, 1.0}, {1.0, 0.0, 1.0}); };
  NoiseOptions noise;
  noise.late_label_frames = 4;
  Simulator simulator(scene, noise, 0);
  int in_view = 0;
  bool known = false;
  for (int k = 0; k < 40; ++k) {
    const SimulatedFrame frame = simulator.Next();
    in_view += frame.true_pixels.count(1);
    const bool labelled = std::count(frame.scan.labels.begin(), frame.scan.labels.end(), 1) > 0;
    EXPECT_EQ(labelled, frame.true_pixels.count(1) > 0 && in_view > 4);
    EXPECT_EQ(frame.motions.size(), known ? 1u : 0u);
    known = known || labelled;
  }
  EXPECT_GT(in_view, 10);
}

}  // namespace
}  // namespace clearance::sim
