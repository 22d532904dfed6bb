#include "server/integration/converged_surface.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <set>
#include <tuple>
#include <vector>

namespace clearance {
namespace {

using Eigen::Vector3d;
using Key = std::tuple<int, int, int>;

constexpr double kVoxel = 0.1;

// A plane through `through`, and points on it within a metre.
struct Plane {
  Vector3d normal, through;

  double Distance(const Vector3d& p) const { return normal.dot(p - through); }
  LocalVoxels Seen(double off_m) const {
    const Vector3d u = normal.unitOrthogonal(), v = normal.cross(u);
    std::vector<Vector3d> points;
    for (double a = -1; a <= 1; a += 0.013) {
      for (double b = -1; b <= 1; b += 0.013) {
        points.push_back(through + a * u + b * v + off_m * normal);
      }
    }
    Eigen::Matrix3Xf local(3, points.size());
    std::vector<uint32_t> all(points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      local.col(i) = (points[i] - through).cast<float>();
      all[i] = static_cast<uint32_t>(i);
    }
    Pose T = Pose::Identity();
    T.translation() = through;
    return GatherVoxels(local, all, T, kVoxel);
  }
};

Plane RandomPlane(int seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> gauss;
  Plane plane{{gauss(random), gauss(random), gauss(random)}, {}};
  plane.normal.normalize();
  // Negative coordinates, and far from the origin.
  plane.through = 200 * Vector3d(gauss(random), gauss(random), gauss(random));
  return plane;
}

// `looks` observations of a signed distance within two voxels of a plane, out to 1.5 m.
SurfaceMap Stored(const Plane& plane, int looks,
                  const std::function<double(const Vector3d&)>& sdf) {
  SurfaceUpdate update;
  const VoxelIndex low = VoxelOf(plane.through - Vector3d::Constant(1.5), kVoxel);
  const VoxelIndex high = VoxelOf(plane.through + Vector3d::Constant(1.5), kVoxel);
  const BlockIndex first = BlockOf(low), last = BlockOf(high);
  for (int x = first.x; x <= last.x; ++x) {
    for (int y = first.y; y <= last.y; ++y) {
      for (int z = first.z; z <= last.z; ++z) {
        const BlockIndex block{x, y, z};
        const uint32_t begin = static_cast<uint32_t>(update.band.offset.size());
        for (int o = 0; o < kBlockVoxels; ++o) {
          const double d = sdf(VoxelCentre(VoxelAt(block, o), kVoxel));
          if (std::abs(d) > 2 * kVoxel) continue;
          update.band.offset.push_back(static_cast<uint16_t>(o));
          update.band.distance_m.push_back(static_cast<float>(d));
          const double voxels = d / kVoxel;  // as a local field is sure of a plane
          update.band.weight.push_back(static_cast<float>(
              std::max(1e-3, std::exp(-voxels * voxels) * std::min(1.0, 1 + 0.5 * voxels))));
        }
        const uint32_t end = static_cast<uint32_t>(update.band.offset.size());
        if (end > begin) update.band.blocks.push_back({block, begin, end});
      }
    }
  }
  SurfaceMap map(kVoxel);
  for (int i = 0; i < looks; ++i) map.Apply(update, {});
  return map;
}

double ConvergedShare(const Plane& plane, int looks, double off_voxels, double noise_voxels) {
  const SurfaceMap map = Stored(plane, looks, [&](const Vector3d& p) { return plane.Distance(p); });
  const LocalVoxels seen = plane.Seen(off_voxels * kVoxel);
  const std::vector<KnownSurface> known = FindKnownSurface(seen, map, noise_voxels * kVoxel);
  size_t converged = 0;
  for (size_t b = 0; b < seen.blocks.size(); ++b) {
    for (uint32_t i = seen.blocks[b].begin; i < seen.blocks[b].end; ++i) {
      converged += clearance::Test(known[b].converged, seen.offset[i]);
    }
  }
  return static_cast<double>(converged) / static_cast<double>(seen.offset.size());
}

TEST(ConvergedSurface, TakesTwoLooksAndMoreWithNoise) {
  for (int seed = 0; seed < 5; ++seed) {
    const Plane plane = RandomPlane(seed);
    EXPECT_EQ(ConvergedShare(plane, 1, 0, 0), 0) << seed;
    EXPECT_GT(ConvergedShare(plane, 3, 0, 0), 0.9) << seed;
    EXPECT_EQ(ConvergedShare(plane, 3, 0, 0.2), 0) << seed;
    EXPECT_GT(ConvergedShare(plane, 11, 0, 0.2), 0.9) << seed;
  }
}

TEST(ConvergedSurface, HasToAgreeWithTheFrame) {
  for (int seed = 10; seed < 15; ++seed) {
    const Plane plane = RandomPlane(seed);
    EXPECT_GT(ConvergedShare(plane, 3, 0.05, 0), 0.9) << seed;
    EXPECT_EQ(ConvergedShare(plane, 3, 0.15, 0), 0) << seed;
    EXPECT_EQ(ConvergedShare(plane, 3, -0.15, 0), 0) << seed;
  }
}

TEST(ConvergedSurface, EndsWhereTheWallEnds) {
  for (int seed = 20; seed < 25; ++seed) {
    const Plane plane = RandomPlane(seed);
    const Vector3d side = plane.normal.unitOrthogonal();  // of a wall that ends in the middle
    const auto wedge = [&](const Vector3d& p) {
      return std::max(plane.Distance(p), side.dot(p - plane.through));
    };
    const SurfaceMap map = Stored(plane, 5, wedge);
    const LocalVoxels seen = plane.Seen(0);
    const std::vector<KnownSurface> known = FindKnownSurface(seen, map, 0);
    size_t converged = 0;
    for (size_t b = 0; b < seen.blocks.size(); ++b) {
      for (uint32_t i = seen.blocks[b].begin; i < seen.blocks[b].end; ++i) {
        if (!clearance::Test(known[b].converged, seen.offset[i])) continue;
        const Vector3d centre = VoxelCentre(VoxelAt(seen.blocks[b].block, seen.offset[i]), kVoxel);
        EXPECT_LT(side.dot(centre - plane.through), 0) << seed;
        ++converged;
      }
    }
    EXPECT_GT(converged, 100u) << seed;
  }
}

TEST(ConvergedSurface, ConfirmsTheSamePlaneInItsFaceNeighboursAcrossBlocks) {
  for (int seed = 30; seed < 35; ++seed) {
    const Plane plane = RandomPlane(seed);
    const SurfaceMap map = Stored(plane, 3, [&](const Vector3d& p) { return plane.Distance(p); });
    const LocalVoxels seen = plane.Seen(0);
    const std::vector<KnownSurface> known = FindKnownSurface(seen, map, 0);
    std::set<Key> confirmed, expected;
    size_t across = 0;
    const auto key = [](const VoxelIndex& v) { return Key(v.x(), v.y(), v.z()); };
    for (size_t b = 0; b < seen.blocks.size(); ++b) {
      for (int n = 0; n <= KnownSurface::kOwn; ++n) {
        BlockIndex block = seen.blocks[b].block;
        if (n < KnownSurface::kOwn) {
          (n < 2 ? block.x : n < 4 ? block.y : block.z) += n & 1 ? 1 : -1;
        }
        for (int o = 0; o < kBlockVoxels; ++o) {
          if (!clearance::Test(known[b].confirmed[n], o)) continue;
          confirmed.insert(key(VoxelAt(block, o)));
          across += n < KnownSurface::kOwn;
        }
      }
      for (uint32_t i = seen.blocks[b].begin; i < seen.blocks[b].end; ++i) {
        if (!clearance::Test(known[b].converged, seen.offset[i])) continue;
        const VoxelIndex v = VoxelAt(seen.blocks[b].block, seen.offset[i]);
        expected.insert(key(v));
        for (int n = 0; n < 6; ++n) {
          VoxelIndex beside = v;
          beside[n >> 1] += n & 1 ? 1 : -1;
          // Away from the limit itself, which rounding decides.
          const double d = std::abs(plane.Distance(VoxelCentre(beside, kVoxel))) / kVoxel;
          if (d < 0.899) expected.insert(key(beside));
        }
      }
    }
    for (const Key& k : expected) EXPECT_TRUE(confirmed.contains(k)) << seed;
    for (const auto& [x, y, z] : confirmed) {
      EXPECT_LT(std::abs(plane.Distance(VoxelCentre({x, y, z}, kVoxel))), 0.901 * kVoxel) << seed;
    }
    EXPECT_GT(across, 20u) << seed;
  }
}

TEST(ConvergedSurface, WhatIsSeenAgainGrowsSurerButDoesNotMove) {
  SurfaceMap map(kVoxel);
  SurfaceUpdate update;
  const BlockIndex block{-3, 2, -1};
  update.band.blocks = {{block, 0, 2}};
  update.band.offset = {100, 101};
  update.band.distance_m = {0.f, -0.08f};
  update.band.weight = {1.f, 1.f};
  FusionOptions options;
  map.Apply(update, options);
  update.band.weight = {0.f, 0.f};
  update.band.distance_m = {0.f, -0.08f};
  size_t told = 0;
  for (int i = 0; i < 40; ++i) told += !map.Apply(update, options).empty();
  EXPECT_EQ(map.MeanBlock(block)[100], 0.f);
  EXPECT_EQ(map.WeightBlock(block)[100], options.max_weight);
  EXPECT_EQ(map.MeanBlock(block)[101], -0.08f);
  EXPECT_EQ(map.WeightBlock(block)[101], 1.f) << "deep behind the surface nothing was seen";
  EXPECT_EQ(told, 2u) << "at 4 and at 16";
}

}  // namespace
}  // namespace clearance
