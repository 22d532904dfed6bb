// Alg. 1 as a whole, on analytic scenes: what goes to the static map, what to an object.
#include "server/integration/frame_integrator.h"

#include <gtest/gtest.h>

#include <cmath>

#include "server/map/free_evidence.h"
#include "tests/testing/analytic_scene.h"

namespace clearance {
namespace {

using testing::AnalyticScene;
using testing::Intrinsics;
using testing::LookAt;
using testing::Solid;

constexpr double kVoxel_m = 0.1;
constexpr uint16_t kCar = 4;

MapConfig Config() {
  MapConfig config;
  config.voxel_size_m = kVoxel_m;
  config.max_range_m = 12;
  return config;
}

// A floor, a wall 8 m ahead and a box that moves along y; everything shifted by `origin`.
class FrameIntegratorTest : public ::testing::TestWithParam<double> {
 protected:
  FrameIntegratorTest() : origin_(GetParam(), -GetParam(), 0.5 * GetParam()) {}

  AnalyticScene SceneAt(double y, bool labelled) const {
    Solid floor;
    floor.kind = Solid::Kind::kHalfSpace;
    floor.T_W_P = Pose(Eigen::Translation3d(origin_));
    Solid wall;
    wall.size = {0.4, 30, 6};
    wall.T_W_P = Pose(Eigen::Translation3d(origin_ + Eigen::Vector3d(8.2, 0, 3)));
    Solid car;
    car.size = {1.2, 2.0, 1.4};
    car.T_W_P = CarPose(y);
    car.label = labelled ? kCar : 0;
    return AnalyticScene("street", {floor, wall, car});
  }

  Pose CarPose(double y) const {
    return Pose(Eigen::Translation3d(origin_ + Eigen::Vector3d(5, y, 0.95)));
  }

  Frame FrameAt(uint64_t k, double y, bool labelled) const {
    Frame frame;
    frame.frame_id = k;
    frame.stamp_ns = int64_t(k) * 100'000'000;
    frame.source_id = "camera";
    frame.T_W_X =
        LookAt(origin_ + Eigen::Vector3d(0, 0, 1.5), origin_ + Eigen::Vector3d(8, 0, 1.2));
    frame.observation = SceneAt(y, labelled).RenderDepth(frame.T_W_X, Intrinsics::Small());
    return frame;
  }

  // Integrates and applies; H_W shifts the car by dy since the last frame.
  MapUpdate Run(const Frame& frame) {
    const FrameIntegrator integrator(IntegratorOptions::For(Config()));
    auto update = integrator.Integrate(frame, map_);
    EXPECT_TRUE(update.ok()) << update.status();
    map_.Apply(*update);
    return *std::move(update);
  }

  static ObjectMotion Shift(double dy) {
    ObjectMotion motion;
    motion.object_id = ObjectId(kCar);
    motion.pose = Pose(Eigen::Translation3d(0, dy, 0));
    return motion;
  }

  // Static voxels with weight that lie nearer than `reach` to the car's box at y and farther than
  // two voxels from floor and wall.
  int StaticVoxelsAtCar(double y, double reach_m) const {
    const AnalyticScene scene = SceneAt(y, true);
    int count = 0;
    for (const BlockIndex& block : map_.static_map().BandBlocks()) {
      const float* weight = map_.static_map().WeightBlock(block);
      for (int o = 0; o < kBlockVoxels; ++o) {
        if (weight[o] == 0) continue;
        const Eigen::Vector3d p = VoxelCentre(VoxelAt(block, o), kVoxel_m);
        if (std::abs(scene.solids()[2].Distance(p)) > reach_m) continue;
        if (scene.solids()[0].Distance(p) < 0.3 || scene.solids()[1].Distance(p) < 0.3) continue;
        ++count;
      }
    }
    return count;
  }

  Eigen::Vector3d origin_;
  WorldMap map_{Config()};
};

TEST_P(FrameIntegratorTest, SurfaceGoesToTheObjectAndFreeEvidenceToTheStaticMap) {
  double y = -1.5;
  for (int k = 0; k < 8; ++k, y += 0.25) {
    Frame frame = FrameAt(k, y, true);
    if (k > 0) frame.motions = {Shift(0.25)};
    const MapUpdate update = Run(frame);
    EXPECT_TRUE(update.violations.empty());
    EXPECT_EQ(update.objects.size(), 1u);
  }
  EXPECT_EQ(StaticVoxelsAtCar(y - 0.25, 0.25), 0);
  // The submap is the car's surface in L: every fused voxel with weight agrees with the box.
  const ObjectSubmap& object = map_.objects().at(ObjectId(kCar));
  const Pose T_B_L = CarPose(y - 0.25).inverse() * object.T_W_L();
  Solid box;
  box.size = {1.2, 2.0, 1.4};
  double sum = 0;
  int count = 0;
  for (const BlockIndex& block : object.surface().BandBlocks()) {
    const float* mean = object.surface().MeanBlock(block);
    const float* weight = object.surface().WeightBlock(block);
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (weight[o] < 1 || std::abs(mean[o]) > 0.08) continue;
      const double truth = box.Distance(T_B_L * VoxelCentre(VoxelAt(block, o), kVoxel_m));
      sum += std::abs(truth - mean[o]);
      ++count;
    }
  }
  EXPECT_GT(count, 200);
  EXPECT_LT(sum / count, 0.35 * kVoxel_m);
  // Rays that ended on the car left free evidence in front of it.
  std::vector<int32_t> evidence(kHaloVoxels);
  const VoxelIndex before = VoxelOf(origin_ + Eigen::Vector3d(3, 0, 1.2), kVoxel_m);
  map_.static_map().ReadEvidence(BlockOf(before), evidence.data());
  const VoxelIndex in = before - FirstVoxel(BlockOf(before));
  EXPECT_TRUE(IsFree(FreeEvidence::Unpack(evidence[HaloOffset(in.x(), in.y(), in.z())])));
}

TEST_P(FrameIntegratorTest, StaticSurfaceIsReleasedWhenAnObjectClaimsIt) {
  for (int k = 0; k < 10; ++k) Run(FrameAt(k, 0, /*labelled=*/false));  // parked, static
  ASSERT_GT(StaticVoxelsAtCar(0, 0.05), 100);
  Run(FrameAt(10, 0, /*labelled=*/true));  // now it is an object
  EXPECT_EQ(StaticVoxelsAtCar(0, 0.05), 0);
  EXPECT_EQ(map_.objects().size(), 1u);
}

TEST_P(FrameIntegratorTest, LateLabelsLeaveLittleWhereTheObjectCameFrom) {
  const double first = 1.2;  // from here on the camera sees the same two sides of it
  double y = first;
  for (int k = 0; k < 6; ++k, y += 0.25) Run(FrameAt(k, y, /*labelled=*/false));
  Run(FrameAt(6, y, true));
  int traces = 0;
  for (double at = y; at > first - 0.1; at -= 0.25) traces += StaticVoxelsAtCar(at, 0.05);
  ASSERT_GT(traces, 100);
  // Nobody looks: only the motion tells where the car was.
  Frame frame = FrameAt(7, y + 0.25, true);
  frame.motions = {Shift(0.25)};
  frame.T_W_X = LookAt(origin_ + Eigen::Vector3d(0, 0, 1.5), origin_ + Eigen::Vector3d(-8, 0, 0.5));
  frame.observation = SceneAt(y + 0.25, true).RenderDepth(frame.T_W_X, Intrinsics::Small());
  Run(frame);
  // What the submap, of one look at a side seen edge-on, does not hold waits for the next look
  // back.
  int left = 0;
  for (; y > first - 0.1; y -= 0.25) left += StaticVoxelsAtCar(y, 0.05);
  EXPECT_LE(left, 0.4 * traces);
}

TEST_P(FrameIntegratorTest, ReturnsFromAKnownObjectAreNotStaticWhateverTheirLabel) {
  double y = -1;
  for (int k = 0; k < 5; ++k, y += 0.25) {
    Frame frame = FrameAt(k, y, /*labelled=*/k < 3);
    if (k > 0) frame.motions = {Shift(0.25)};
    Run(frame);
    // Hundreds of voxels, were its returns believed; its outline is a little wider than its map.
    EXPECT_LE(StaticVoxelsAtCar(y, 0.05), 5) << "frame " << k;
  }
  // The wall behind is static, in the same frames.
  EXPECT_GT(map_.static_map().BandBlocks().size(), 100u);
}

TEST_P(FrameIntegratorTest, AnObjectWhoseReturnsTurnStaticWhereItWasStands) {
  double y = -1;
  for (int k = 0; k < 5; ++k) {
    Frame frame = FrameAt(k, y, true);
    if (k > 0) frame.motions = {Shift(0.2)};
    Run(frame);
    if (k < 4) y += 0.2;
  }
  const Pose before = map_.objects().at(ObjectId(kCar)).T_W_L();
  ASSERT_FALSE(map_.objects().at(ObjectId(kCar)).screw_W().isZero(0.1));
  for (int k = 5; k < 9; ++k) Run(FrameAt(k, y, /*labelled=*/false));
  const ObjectSubmap& stands = map_.objects().at(ObjectId(kCar));
  EXPECT_TRUE(stands.T_W_L().isApprox(before, 1e-9));
  EXPECT_TRUE(stands.screw_W().isZero(0));
  EXPECT_EQ(stands.life_state(), LifeState::kCoasting) << "it retires like any other";
  EXPECT_GT(StaticVoxelsAtCar(y, 0.05), 100) << "its returns are static now";
}

TEST_P(FrameIntegratorTest, AnObjectThatLeftUnlabelledCoasts) {
  double y = -1;
  for (int k = 0; k < 5; ++k) {
    Frame frame = FrameAt(k, y, true);
    if (k > 0) frame.motions = {Shift(0.3)};
    Run(frame);
    if (k < 4) y += 0.3;
  }
  const Pose before = map_.objects().at(ObjectId(kCar)).T_W_L();
  Run(FrameAt(5, y + 0.3, /*labelled=*/false));
  const Eigen::Vector3d moved =
      map_.objects().at(ObjectId(kCar)).T_W_L().translation() - before.translation();
  EXPECT_NEAR(moved.y(), 0.3, 0.01);
}

TEST_P(FrameIntegratorTest, PointsOfAnObjectWithoutAPoseReachNeitherMap) {
  Run(FrameAt(0, -1, true));
  Frame moved = FrameAt(1, -0.5, true);
  moved.motions = {Shift(0.5)};
  Run(moved);
  const size_t blocks = map_.objects().at(ObjectId(kCar)).surface().BandBlocks().size();
  Run(FrameAt(2, 1.5, true));  // jumped, and nobody says how
  const ObjectSubmap& object = map_.objects().at(ObjectId(kCar));
  EXPECT_EQ(object.life_state(), LifeState::kCoasting);
  EXPECT_EQ(object.surface().BandBlocks().size(), blocks);
  EXPECT_EQ(StaticVoxelsAtCar(1.5, 0.2), 0);
}

TEST_P(FrameIntegratorTest, IsPureAndGivesTheSameUpdateTwice) {
  Run(FrameAt(0, -1, true));
  const FrameIntegrator integrator(IntegratorOptions::For(Config()));
  const Frame frame = FrameAt(1, -0.8, true);
  const uint64_t bytes = map_.MemoryBytes();
  const auto first = integrator.Integrate(frame, map_), second = integrator.Integrate(frame, map_);
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_EQ(map_.MemoryBytes(), bytes);
  EXPECT_EQ(map_.revision(), 1u);
  EXPECT_EQ(first->static_surface.band.distance_m, second->static_surface.band.distance_m);
  EXPECT_EQ(first->static_surface.band.weight, second->static_surface.band.weight);
  EXPECT_EQ(first->static_surface.band.offset, second->static_surface.band.offset);
}

TEST_P(FrameIntegratorTest, RefusesABadFrameAndAcceptsOneWithoutPoints) {
  const FrameIntegrator integrator(IntegratorOptions::For(Config()));
  Frame frame = FrameAt(0, 0, true);
  std::get<DepthImage>(frame.observation).depth.pop_back();
  EXPECT_EQ(integrator.Integrate(frame, map_).status().code(), absl::StatusCode::kInvalidArgument);
  frame.observation = std::monostate{};
  EXPECT_TRUE(integrator.Integrate(frame, map_).ok());
}

TEST_P(FrameIntegratorTest, NothingOutsideTheBoundsIsMapped) {
  MapConfig config = Config();
  config.bounds = Aabb(origin_ + Eigen::Vector3d(1, -2, 0.3), origin_ + Eigen::Vector3d(6, 2, 2));
  WorldMap map(config);
  const FrameIntegrator integrator(IntegratorOptions::For(config));
  const auto update = integrator.Integrate(FrameAt(0, 0, false), map);
  ASSERT_TRUE(update.ok());
  ASSERT_FALSE(update->static_surface.free.empty());
  for (const FreeBlock& f : update->static_surface.free) {
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (!clearance::Test(f.probable, o)) continue;
      EXPECT_TRUE(config.bounds->contains(VoxelCentre(VoxelAt(f.block, o), kVoxel_m)));
    }
  }
  const Aabb padded(config.bounds->min() - Eigen::Vector3d::Constant(0.5),
                    config.bounds->max() + Eigen::Vector3d::Constant(0.5));
  for (const auto& b : update->static_surface.band.blocks) {
    for (uint32_t i = b.begin; i < b.end; ++i) {
      const VoxelIndex v = VoxelAt(b.block, update->static_surface.band.offset[i]);
      EXPECT_TRUE(padded.contains(VoxelCentre(v, kVoxel_m)));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(NearAndFar, FrameIntegratorTest, ::testing::Values(0.0, -37.3, 10'003.7));

}  // namespace
}  // namespace clearance
