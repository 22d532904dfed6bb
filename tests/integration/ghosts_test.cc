// Stored surface that is gone must go, and surface that is there must stay.
#include <gtest/gtest.h>

#include <functional>
#include <random>

#include "server/integration/free_space.h"
#include "server/integration/stored_surface.h"
#include "server/map/surface_map.h"
#include "tests/testing/analytic_scene.h"
#include "tests/testing/ray_oracle.h"

namespace clearance {
namespace {

using testing::AnalyticScene;
using testing::RayOracle;
using testing::Solid;

constexpr double kRange = 12.0;

struct Rig {
  double h = 0.1;
  bool lidar = false;
  double noise_m = 0, jitter_m = 0;
  Pose T_W_S = Pose::Identity();  // where the scene is
};

// Writes d at voxel centres within the band of 2 voxels, `frames` times at weight 1.
void StoreBand(SurfaceMap& map, const Eigen::AlignedBox3d& region, int frames,
               const std::function<double(const Eigen::Vector3d&)>& distance) {
  const double h = map.voxel_size_m();
  const BlockIndex low = BlockOf(VoxelOf(region.min(), h));
  const BlockIndex high = BlockOf(VoxelOf(region.max(), h));
  SurfaceUpdate update;
  BandObservations& band = update.band;
  for (int x = low.x; x <= high.x; ++x) {
    for (int y = low.y; y <= high.y; ++y) {
      for (int z = low.z; z <= high.z; ++z) {
        const auto begin = static_cast<uint32_t>(band.offset.size());
        for (int o = 0; o < kBlockVoxels; ++o) {
          const Eigen::Vector3d c = VoxelCentre(VoxelAt({x, y, z}, o), h);
          const double d = distance(c);
          if (!region.contains(c) || std::abs(d) > 2 * h) continue;
          band.offset.push_back(static_cast<uint16_t>(o));
          band.distance_m.push_back(static_cast<float>(d));
          band.weight.push_back(1.f);
        }
        const auto end = static_cast<uint32_t>(band.offset.size());
        if (end > begin) band.blocks.push_back({{x, y, z}, begin, end});
      }
    }
  }
  for (int i = 0; i < frames; ++i) map.Apply(update, {});
}

Frame See(const AnalyticScene& scene, const Pose& T_W_camera, const Rig& rig, uint32_t seed) {
  Frame frame;
  Pose T_W_X = T_W_camera;
  if (rig.lidar) {
    testing::LidarModel lidar;
    lidar.rows = 48, lidar.columns = 512;
    lidar.elevation_min_rad = -0.5, lidar.elevation_max_rad = 0.15;
    T_W_X = testing::LidarFromCamera(T_W_camera);
    frame.observation = scene.RenderLidar(T_W_X, lidar, rig.noise_m, seed);
  } else {
    frame.observation = scene.RenderDepth(T_W_X, testing::Intrinsics::Small(), rig.noise_m, seed);
  }
  // The sensor is not quite where it believes to be.
  std::mt19937 rng(seed);
  std::normal_distribution<double> gauss;
  const double x = gauss(rng), y = gauss(rng), z = gauss(rng);
  T_W_X.translation() += rig.jitter_m * Eigen::Vector3d(x, y, z);
  frame.T_W_X = T_W_X;
  return frame;
}

LocalVoxels StaticVoxels(const Frame& frame, double h) {
  std::vector<Eigen::Vector3f> points;
  testing::ForEachReturn(frame, [&](const Eigen::Vector3d& p_X, uint16_t label) {
    if (label == 0 && p_X.norm() <= kRange) points.push_back(p_X.cast<float>());
  });
  Eigen::Matrix3Xf points_X(3, points.size());
  std::vector<uint32_t> indices;
  for (size_t i = 0; i < points.size(); ++i) {
    points_X.col(static_cast<Eigen::Index>(i)) = points[i];
    indices.push_back(static_cast<uint32_t>(i));
  }
  return GatherVoxels(points_X, indices, frame.T_W_X, h);
}

// Lets the map look at a frame; only free evidence is fused, so nothing renews the surface.
void Observe(SurfaceMap& map, const Frame& frame) {
  const double h = map.voxel_size_m();
  const RangeImage image =
      std::holds_alternative<DepthImage>(frame.observation)
          ? RangeImage::FromDepth(std::get<DepthImage>(frame.observation), kRange)
          : RangeImage::FromCloud(std::get<PointCloud>(frame.observation), 0.5 * h / kRange,
                                  kRange);
  SurfaceUpdate update;
  update.free = ObserveFreeSpace(image, frame.T_W_X, StaticVoxels(frame, h), map, {h, kRange});
  map.Apply(update, {});
}

// Whether the map still holds surface in the cube: band whose mean is within or behind it.
bool Holds(const SurfaceMap& map, const VoxelIndex& v) {
  const float* weight = map.WeightBlock(BlockOf(v));
  if (!weight || weight[OffsetOf(v)] < FusionOptions{}.min_weight) return false;
  return map.MeanBlock(BlockOf(v))[OffsetOf(v)] < 0.5 * map.voxel_size_m();
}

Solid Ground() {
  Solid s;
  s.kind = Solid::Kind::kHalfSpace;
  return s;
}

Solid Box(const Eigen::Vector3d& centre, const Eigen::Vector3d& size) {
  Solid s;
  s.kind = Solid::Kind::kBox;
  s.T_W_P.translation() = centre;
  s.size = size;
  return s;
}

// A street: ground, a wall, a pole; a car that left stood before the wall.
AnalyticScene Street() {
  Solid pole;
  pole.kind = Solid::Kind::kCylinder;
  pole.T_W_P.translation() = Eigen::Vector3d(4.03, 1.51, 1.5);
  pole.size = Eigen::Vector3d(0.05, 0, 3);
  return AnalyticScene("street", {Ground(), Box({6, 4, 1.5}, {12, 0.3, 3}), pole});
}
const Eigen::Vector3d kCarCentre(5.5, 0.3, 0.75), kCarSize(3.6, 1.6, 1.2);

std::vector<Pose> Drive(const Pose& T_W_S, int frames) {
  std::vector<Pose> views;
  for (int i = 0; i < frames; ++i) {
    const Eigen::Vector3d eye(-1.5 + 0.25 * i, -1 - 0.1 * i, 1.45);
    views.push_back(T_W_S * testing::LookAt(eye, {5.5, 0.8 + 0.1 * i, 0.6}));
  }
  return views;
}

class Ghosts : public ::testing::TestWithParam<std::tuple<bool /*lidar*/, int /*pose*/>> {
 protected:
  Rig MakeRig() const {
    Rig rig;
    rig.lidar = std::get<0>(GetParam());
    rig.h = rig.lidar ? 0.2 : 0.1;
    if (std::get<1>(GetParam()) == 1) {
      rig.T_W_S = testing::RandomPose(5, 10);
      rig.T_W_S.translation() += Eigen::Vector3d(-10'000, 12'000, 50);
    }
    return rig;
  }
  static Eigen::AlignedBox3d Around(const Pose& T_W_S) {
    Eigen::AlignedBox3d box;
    for (int i = 0; i < 8; ++i) {
      box.extend(T_W_S * Eigen::Vector3d(i & 1 ? 13 : -1, i & 2 ? 5 : -4, i & 4 ? 3.5 : -0.7));
    }
    return box;
  }
};

TEST_P(Ghosts, VanishOnceThreeRaysWentThroughThem) {
  const Rig rig = MakeRig();
  const AnalyticScene scene = Street().Moved(rig.T_W_S);
  const AnalyticScene car = AnalyticScene("car", {Box(kCarCentre, kCarSize)}).Moved(rig.T_W_S);
  for (const int seen : {1, 30}) {  // frames that took the car for static
    SurfaceMap map(rig.h);
    StoreBand(map, Around(rig.T_W_S), seen,
              [&](const Eigen::Vector3d& p) { return car.Distance(p); });
    RayOracle oracle(rig.h, kRange);
    uint32_t seed = 0;
    for (const Pose& view : Drive(rig.T_W_S, 6)) {
      const Frame frame = See(scene, view, rig, ++seed);
      Observe(map, frame);
      oracle.Add(frame);
    }
    int judged = 0, ghosts = 0;
    for (const auto& [block, rays] : oracle.blocks()) {
      for (int o = 0; o < kBlockVoxels; ++o) {
        const VoxelIndex v = VoxelAt(block, o);
        const Eigen::Vector3d c = VoxelCentre(v, rig.h);
        if (rays[o] < 3 || std::abs(car.Distance(c)) > rig.h) continue;
        if (scene.Distance(c) < rig.h) continue;
        ++judged;
        ghosts += Holds(map, v);
      }
    }
    EXPECT_GT(judged, rig.lidar ? 300 : 2000);
    // A camera asks for the pixels at a cube's middle: a little stays where rays only passed
    // through corners.
    EXPECT_LE(ghosts, rig.lidar ? 0 : 0.02 * judged)
        << "of " << judged << ", seen " << seen << " times as static";
  }
}

TEST_P(Ghosts, KeepTrueSurfaceDespiteNoiseAndJitter) {
  Rig rig = MakeRig();
  const AnalyticScene scene = Street().Moved(rig.T_W_S);
  for (const auto& [noise_m, jitter_m] : {std::pair{0.0, 0.0}, {0.02, 0.01}}) {
    rig.noise_m = noise_m;
    rig.jitter_m = jitter_m;
    const auto distance = [&](const Eigen::Vector3d& p) { return scene.Distance(p); };
    SurfaceMap map(rig.h), before(rig.h);
    StoreBand(map, Around(rig.T_W_S), 5, distance);
    StoreBand(before, Around(rig.T_W_S), 5, distance);
    RayOracle oracle(rig.h, kRange);
    uint32_t seed = 100;
    for (const Pose& view : Drive(rig.T_W_S, 8)) {
      const Frame frame = See(scene, view, rig, ++seed);
      Observe(map, frame);
      oracle.Add(frame);
    }
    int surface = 0, lost = 0, pole = 0, pole_lost = 0;
    for (const auto& [block, rays] : oracle.blocks()) {
      for (int o = 0; o < kBlockVoxels; ++o) {
        const VoxelIndex v = VoxelAt(block, o);
        const Eigen::Vector3d c = VoxelCentre(v, rig.h);
        if (rays[o] == 0 || !Holds(before, v)) continue;
        if (std::abs(scene.Distance(c)) > 0.45 * rig.h) continue;
        const bool gone = !Holds(map, v);
        ++surface;
        lost += gone;
        if (std::abs(scene.solids()[2].Distance(c)) < 0.45 * rig.h) {
          ++pole;
          pole_lost += gone;
        }
      }
    }
    EXPECT_GT(surface - pole, 400);
    EXPECT_GT(pole, 10);
    EXPECT_LE(lost - pole_lost, 1 + 0.002 * (surface - pole))
        << "noise " << noise_m << ", of " << surface;
    // Cubes on the far side of a pole return no ray, and rays pass beside it; nothing here renews
    // them.
    EXPECT_LE(pole_lost, 0.6 * pole) << "noise " << noise_m << ", of " << pole;
  }
}

TEST_P(Ghosts, KeepWhatNoRayReached) {
  const Rig rig = MakeRig();
  AnalyticScene scene = Street();
  scene.solids().push_back(Box({2, 0, 1.5}, {0.3, 8, 3}));  // a wall across, before everything
  scene = scene.Moved(rig.T_W_S);
  const AnalyticScene car = AnalyticScene("car", {Box(kCarCentre, kCarSize)}).Moved(rig.T_W_S);
  SurfaceMap map(rig.h);
  StoreBand(map, Around(rig.T_W_S), 2, [&](const Eigen::Vector3d& p) { return car.Distance(p); });
  for (const Pose& view : Drive(rig.T_W_S, 4)) Observe(map, See(scene, view, rig, 1));
  int stored = 0, gone = 0;
  for (const BlockIndex& block : map.BandBlocks()) {
    for (int o = 0; o < kBlockVoxels; ++o) {
      const VoxelIndex v = VoxelAt(block, o);
      if (std::abs(car.Distance(VoxelCentre(v, rig.h))) > 0.4 * rig.h) continue;
      ++stored;
      gone += !Holds(map, v);
    }
  }
  EXPECT_GT(stored, 100);
  EXPECT_EQ(gone, 0);
}

INSTANTIATE_TEST_SUITE_P(Sensors, Ghosts,
                         ::testing::Combine(::testing::Bool(), ::testing::Range(0, 2)));

TEST(GhostSurface, LeavesNoInsidesWithoutASurface) {
  // Only what was behind the surface is left of a ghost: no zero crossing, yet not free.
  const AnalyticScene scene("wall", {Box({8, 0, 0}, {0.5, 20, 20})});
  SurfaceMap map(0.1);
  StoreBand(map, {Eigen::Vector3d(3, -1, -1), Eigen::Vector3d(4, 1, 1)}, 6,
            [](const Eigen::Vector3d& p) { return p.x() > 3.5 ? -0.15 : 1.0; });
  ASSERT_FALSE(map.BandBlocks().empty());
  for (int i = 0; i < 3; ++i) {
    Observe(map, See(scene, testing::LookAt({0, 0.1 * i, 0}, {8, 0, 0}), {}, 1));
  }
  for (const BlockIndex& block : map.BandBlocks()) {
    for (int o = 0; o < kBlockVoxels; ++o) EXPECT_FALSE(Holds(map, VoxelAt(block, o)));
  }
}

TEST(Refutation, NeedsAsManyVotesAsTheSurfaceHasFriends) {
  const VoxelIndex v(3, -2, 9), elsewhere(-5, 1, 1);
  SurfaceMap map(0.1);
  SurfaceUpdate hit, against;
  hit.free.push_back({BlockOf(v)});
  Set(hit.free[0].hit, OffsetOf(v));
  against.band.blocks.push_back({BlockOf(v), 0, 1});
  against.band.offset.push_back(static_cast<uint16_t>(OffsetOf(v)));
  against.band.distance_m.push_back(0.01f);
  against.band.weight.push_back(1.f);
  EXPECT_TRUE(IsRefuted(map, v, v, 1, 0)) << "never returned, surely behind";
  EXPECT_FALSE(IsRefuted(map, v, v, 0, 2)) << "two rays may have passed beside";
  against.band.weight[0] = 0.5f;
  map.Apply(against, {});
  EXPECT_TRUE(IsRefuted(map, v, v, 0, 1)) << "never returned, a guess from beside";
  map.Apply(hit, {});
  ASSERT_EQ(map.EvidenceAt(v).returns, 1);
  EXPECT_FALSE(IsRefuted(map, v, v, 0, 2)) << "two rays may have passed beside";
  EXPECT_TRUE(IsRefuted(map, v, v, 0, 3));
  for (int i = 1; i < 5; ++i) map.Apply(hit, {});
  EXPECT_FALSE(IsRefuted(map, v, v, 2, 0)) << "two rays against five frames";
  EXPECT_TRUE(IsRefuted(map, v, v, 3, 0));
  EXPECT_FALSE(IsRefuted(map, elsewhere, v, 2, 0)) << "the surface's cube has the returns";
  // Doubt in two frames in a row is as good as three rays in one.
  map.Apply(against, {});
  SurfaceUpdate doubt;
  doubt.free.push_back({BlockOf(v)});
  Set(doubt.free[0].contradicted, OffsetOf(v));
  map.Apply(doubt, {});
  EXPECT_FALSE(IsRefuted(map, v, v, 0, 1)) << "2 votes against 5";
  map.Apply(doubt, {});
  EXPECT_TRUE(IsRefuted(map, v, v, 0, 1));
  map.Apply(hit, {});
  EXPECT_FALSE(IsRefuted(map, v, v, 0, 1)) << "a return silences doubts";
}

TEST(TrueSurface, SparseGroundStaysUnderAFlatLidar) {
  // Rings are metres apart at 30 m: most cubes of the ground see rays pass above and no return.
  const AnalyticScene scene("ground", {Ground()});
  SurfaceMap map(0.2);
  StoreBand(map, {Eigen::Vector3d(10, -5, -0.5), Eigen::Vector3d(34, 5, 0.5)}, 2,
            [](const Eigen::Vector3d& p) { return p.z(); });
  testing::LidarModel lidar;
  for (int i = 0; i < 15; ++i) {
    Frame frame;
    frame.T_W_X.translation() = Eigen::Vector3d(0.5 * i, 0, 1.73);
    frame.T_W_X.linear() =
        Eigen::AngleAxisd(0.002 * (i % 3 - 1), Eigen::Vector3d::UnitY()).toRotationMatrix();
    frame.observation = scene.RenderLidar(frame.T_W_X, lidar, 0.02, i);
    const RangeImage image =
        RangeImage::FromCloud(std::get<PointCloud>(frame.observation), 0.0025, 40);
    SurfaceUpdate update;
    update.free = ObserveFreeSpace(image, frame.T_W_X, StaticVoxels(frame, 0.2), map, {0.2, 40});
    map.Apply(update, {});
  }
  int surface = 0, lost = 0;
  for (double x = 10.1; x < 34; x += 0.2) {
    for (double y = -4.9; y < 5; y += 0.2) {
      const VoxelIndex v = VoxelOf({x, y, -0.1}, 0.2);
      ++surface;
      lost += !Holds(map, v);
    }
  }
  EXPECT_LE(lost, 0.002 * surface) << "of " << surface;
}

}  // namespace
}  // namespace clearance
