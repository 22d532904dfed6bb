#include "server/integration/free_space.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <map>

#include "tests/testing/analytic_scene.h"
#include "tests/testing/ray_oracle.h"

namespace clearance {
namespace {

using testing::RayOracle;
using testing::ViewedScene;

constexpr double kVoxel = 0.1, kRange = 6.0;
constexpr size_t kViews = 4;
const FreeSpaceOptions kOptions{kVoxel, kRange};

struct Sensor {
  bool lidar = false;
  double noise_m = 0;
};

Frame Render(const ViewedScene& viewed, size_t view, const Sensor& sensor) {
  Frame frame;
  if (sensor.lidar) {
    testing::LidarModel lidar;
    lidar.rows = 64, lidar.columns = 512;
    lidar.elevation_min_rad = -0.5, lidar.elevation_max_rad = 0.2;
    frame.T_W_X = testing::LidarFromCamera(viewed.views[view]);
    frame.observation = viewed.scene.RenderLidar(frame.T_W_X, lidar, sensor.noise_m, view);
  } else {
    frame.T_W_X = viewed.views[view];
    frame.observation =
        viewed.scene.RenderDepth(frame.T_W_X, testing::Intrinsics::Small(), sensor.noise_m, view);
  }
  return frame;
}

RangeImage ImageOf(const Frame& frame) {
  if (const auto* depth = std::get_if<DepthImage>(&frame.observation)) {
    return RangeImage::FromDepth(*depth, kRange);
  }
  return RangeImage::FromCloud(std::get<PointCloud>(frame.observation), 0.5 * kVoxel / kRange,
                               kRange);
}

// Share of the cube that is inside a solid, from 5^3 samples.
double SolidShare(const testing::AnalyticScene& scene, const VoxelIndex& v) {
  const Eigen::Vector3d c = VoxelCentre(v, kVoxel);
  if (scene.Distance(c) > 0.867 * kVoxel) return 0;
  int inside = 0;
  for (int i = 0; i < 125; ++i) {
    const Eigen::Vector3d d(i % 5 - 2, i / 5 % 5 - 2, i / 25 - 2);
    inside += scene.Distance(c + d * (0.2 * kVoxel)) < 0;
  }
  return inside / 125.0;
}

struct Marks {
  int64_t probable = 0, confident = 0;
  int64_t unsupported = 0, unsure = 0;      // probable / confident, yet no ray passed
  int64_t in_solid = 0, sure_in_solid = 0;  // more than half of the cube is solid / any of it
  int64_t oracle = 0, found = 0;            // over all frames, voxels that three rays passed
  int64_t visible = 0, visible_found = 0;   // of them, with the centre in sight of some view
};

// Whether a frame looks past the centre of a voxel: in range, in the image, with a return beyond.
bool SeesCentre(const ViewedScene& viewed, const Frame& frame, const VoxelIndex& v) {
  const Eigen::Vector3d c_W = VoxelCentre(v, kVoxel);
  const Eigen::Vector3d c_X = frame.T_W_X.inverse() * c_W;
  const bool camera = std::holds_alternative<DepthImage>(frame.observation);
  if ((camera ? c_X.z() : c_X.norm()) > kRange || (camera && c_X.z() <= 0)) return false;
  if (camera) {
    const auto& k = std::get<DepthImage>(frame.observation);
    const double u = k.fx * c_X.x() / c_X.z() + k.cx, w = k.fy * c_X.y() / c_X.z() + k.cy;
    if (u < 0 || w < 0 || u > k.width - 1 || w > k.height - 1) return false;
  }
  const Eigen::Vector3d eye = frame.T_W_X.translation();
  const auto hit = viewed.scene.Cast(eye, c_W - eye);
  return hit && hit->t > 1;
}

// Fuses every view and compares with walked rays.
Marks Measure(const ViewedScene& viewed, const Sensor& sensor) {
  const SurfaceMap nothing(kVoxel);
  RayOracle oracle(kVoxel, kRange);
  std::map<BlockIndex, BlockMask> seen;
  Marks marks;
  std::vector<Frame> frames;
  for (size_t view = 0; view < std::min<size_t>(kViews, viewed.views.size()); ++view) {
    frames.push_back(Render(viewed, view, sensor));
    const Frame& frame = frames.back();
    RayOracle now(kVoxel, kRange);
    now.Add(frame);
    oracle.Add(frame);
    for (const FreeBlock& free :
         ObserveFreeSpace(ImageOf(frame), frame.T_W_X, LocalVoxels{}, nothing, kOptions)) {
      BlockMask& mask = seen[free.block];
      for (int o = 0; o < kBlockVoxels; ++o) {
        if (!clearance::Test(free.probable, o)) {
          EXPECT_FALSE(clearance::Test(free.confident, o)) << "confident is a part of probable";
          continue;
        }
        Set(mask, o);
        const VoxelIndex v = VoxelAt(free.block, o);
        const bool sure = clearance::Test(free.confident, o);
        const double solid = SolidShare(viewed.scene, v);
        ++marks.probable;
        marks.confident += sure;
        marks.unsupported += now.Rays(v) == 0;
        marks.unsure += sure && now.Rays(v) == 0;
        marks.in_solid += solid > 0.5;
        marks.sure_in_solid += sure && solid > 0;
      }
    }
  }
  for (const auto& [block, counts] : oracle.blocks()) {
    const auto it = seen.find(block);
    for (int o = 0; o < kBlockVoxels; ++o) {
      const VoxelIndex v = VoxelAt(block, o);
      if (counts[o] < 3 || SolidShare(viewed.scene, v) > 0) continue;
      const bool found = it != seen.end() && clearance::Test(it->second, o);
      ++marks.oracle;
      marks.found += found;
      if (!std::any_of(frames.begin(), frames.end(),
                       [&](const Frame& f) { return SeesCentre(viewed, f, v); })) {
        continue;
      }
      ++marks.visible;
      marks.visible_found += found;
    }
  }
  return marks;
}

class FreeSpaceOfScene
    : public ::testing::TestWithParam<std::tuple<int /*scene*/, bool /*lidar*/, int /*pose*/>> {
 protected:
  ViewedScene Scene() const {
    const auto [scene, lidar, pose] = GetParam();
    const ViewedScene viewed = testing::StandardScenes()[scene];
    Pose T_W_S = testing::RandomPose(17 * scene + pose, 20);  // negative coordinates, too
    if (pose == 1) T_W_S.translation() += Eigen::Vector3d(10'000, -12'000, 300);
    return viewed.Moved(T_W_S);
  }
};

TEST_P(FreeSpaceOfScene, AgreesWithWalkedRays) {
  const Marks m = Measure(Scene(), {std::get<1>(GetParam()), 0});
  ASSERT_GT(m.oracle, 10'000);
  const bool lidar = std::get<1>(GetParam());
  EXPECT_GE(m.visible_found, 0.97 * m.visible) << "what some view looked past is found";
  // A camera asks for the centre: at the border of a few views, rays pass beside it. Of a cloud,
  // rays that end just beyond a cube stop before they leave it.
  EXPECT_GE(m.found, (lidar ? 0.985 : 0.91) * m.oracle) << "what three rays passed is found";
  EXPECT_LE(m.unsupported, 0.005 * m.probable) << "what no ray passed is not free";
  // Rays do pass through the outer part of cubes that are mostly solid, a lidar's more often, where
  // they graze floor and walls; walked rays say so, and the fused surface outranks it.
  EXPECT_LE(m.in_solid, (lidar ? 0.025 : 0.002) * m.probable);
  EXPECT_GT(m.confident, 0.2 * m.probable);
  EXPECT_LE(m.unsure, 0.0005 * m.confident);
  EXPECT_EQ(m.sure_in_solid, 0) << "wholly seen cubes hold no surface";
}

TEST_P(FreeSpaceOfScene, KeepsOutOfSolidsUnderNoise) {
  if (std::get<2>(GetParam()) == 1) GTEST_SKIP() << "once a scene is enough";
  const Marks m = Measure(Scene(), {std::get<1>(GetParam()), 0.02});
  EXPECT_GE(m.visible_found, 0.97 * m.visible);
  EXPECT_LE(m.in_solid, (std::get<1>(GetParam()) ? 0.025 : 0.003) * m.probable);
  EXPECT_LE(m.sure_in_solid, 0.0005 * m.confident);
}

INSTANTIATE_TEST_SUITE_P(Scenes, FreeSpaceOfScene,
                         ::testing::Combine(::testing::Range(0, 5), ::testing::Bool(),
                                            ::testing::Range(0, 2)));

TEST(FreeSpace, IsTheSameForAnyNumberOfThreadsAndSorted) {
  const ViewedScene viewed = testing::BoxScene().Moved(testing::RandomPose(3, 30));
  const SurfaceMap nothing(kVoxel);
  for (const bool lidar : {false, true}) {
    const Frame frame = Render(viewed, 0, {lidar, 0});
    std::vector<std::vector<FreeBlock>> results;
    for (const int threads : {1, 2, 5}) {
      tbb::global_control control(tbb::global_control::max_allowed_parallelism, threads);
      results.push_back(
          ObserveFreeSpace(ImageOf(frame), frame.T_W_X, LocalVoxels{}, nothing, kOptions));
    }
    EXPECT_TRUE(std::is_sorted(results[0].begin(), results[0].end(),
                               [](const auto& a, const auto& b) { return a.block < b.block; }));
    for (const auto& other : {results[1], results[2]}) {
      ASSERT_EQ(other.size(), results[0].size());
      for (size_t i = 0; i < other.size(); ++i) {
        EXPECT_EQ(other[i].block, results[0][i].block);
        EXPECT_EQ(other[i].probable, results[0][i].probable);
        EXPECT_EQ(other[i].confident, results[0][i].confident);
      }
    }
  }
}

TEST(FreeSpace, TakesNoReturnForNoEvidence) {
  DepthImage depth;
  depth.width = 320, depth.height = 180;
  depth.fx = depth.fy = 160, depth.cx = 159.5, depth.cy = 89.5;
  depth.depth_scale_m = 0.001;
  depth.depth.assign(320 * 180, 0);
  const SurfaceMap nothing(kVoxel);
  EXPECT_TRUE(ObserveFreeSpace(RangeImage::FromDepth(depth, kRange), Pose::Identity(),
                               LocalVoxels{}, nothing, kOptions)
                  .empty());
  // One pixel in the middle: only voxels on its ray.
  depth.depth[90 * 320 + 160] = 5000;
  int64_t probable = 0;
  for (const FreeBlock& f : ObserveFreeSpace(RangeImage::FromDepth(depth, kRange), Pose::Identity(),
                                             LocalVoxels{}, nothing, kOptions)) {
    EXPECT_EQ(f.confident, BlockMask{});
    for (const uint64_t word : f.probable) probable += __builtin_popcountll(word);
  }
  EXPECT_LE(probable, 60);
}

TEST(FreeSpace, EndsAtTheLongestRange) {
  DepthImage depth;
  depth.width = 320, depth.height = 180;
  depth.fx = depth.fy = 160, depth.cx = 159.5, depth.cy = 89.5;
  depth.depth_scale_m = 0.001;
  depth.depth.assign(320 * 180, 30'000);
  const SurfaceMap nothing(kVoxel);
  double farthest = 0;
  for (const FreeBlock& f : ObserveFreeSpace(RangeImage::FromDepth(depth, kRange), Pose::Identity(),
                                             LocalVoxels{}, nothing, kOptions)) {
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (clearance::Test(f.probable, o)) {
        farthest = std::max(farthest, VoxelCentre(VoxelAt(f.block, o), kVoxel).z());
      }
    }
  }
  EXPECT_LE(farthest, kRange);
  EXPECT_GE(farthest, kRange - 2 * kVoxel);
}

}  // namespace
}  // namespace clearance
