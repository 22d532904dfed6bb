#include "server/integration/claimed_space.h"

#include <gtest/gtest.h>

#include <numeric>
#include <random>
#include <set>
#include <tuple>

#include "server/integration/dilation.h"

namespace clearance {
namespace {

constexpr double kVoxel = 0.1;

std::tuple<int, int, int> Key(const VoxelIndex& v) { return {v.x(), v.y(), v.z()}; }
using VoxelSet = std::set<std::tuple<int, int, int>>;

LocalVoxels Voxels(const Eigen::Matrix3Xf& points) {
  std::vector<uint32_t> all(points.cols());
  std::iota(all.begin(), all.end(), 0);
  return GatherVoxels(points, all, Pose::Identity(), kVoxel);
}

Eigen::Matrix3Xf RandomPoints(int count, std::mt19937& rng) {
  std::uniform_real_distribution<float> unit(-1.2f, 1.2f);  // three blocks across the origin
  Eigen::Matrix3Xf points(3, count);
  for (int i = 0; i < count; ++i) points.col(i) << unit(rng), unit(rng), 0.4f * unit(rng);
  return points;
}

// A map that stores a random distance in some voxels.
SurfaceMap RandomMap(std::mt19937& rng) {
  SurfaceUpdate update;
  std::uniform_real_distribution<float> distance(-0.2f, 0.2f);
  for (int x = -2; x <= 1; ++x) {
    for (int y = -2; y <= 1; ++y) {
      for (int z = -1; z <= 0; ++z) {
        const uint32_t begin = static_cast<uint32_t>(update.band.offset.size());
        for (int o = 0; o < kBlockVoxels; ++o) {
          if (rng() % 3) continue;
          update.band.offset.push_back(static_cast<uint16_t>(o));
          update.band.distance_m.push_back(distance(rng));
          update.band.weight.push_back(1.f);
        }
        update.band.blocks.push_back(
            {{x, y, z}, begin, static_cast<uint32_t>(update.band.offset.size())});
      }
    }
  }
  SurfaceMap map(kVoxel);
  map.Apply(update, {});
  return map;
}

bool Near(const VoxelSet& set, const VoxelIndex& v) {
  for (int k = 0; k < 27; ++k) {
    if (set.contains(Key(v + VoxelIndex(k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1)))) return true;
  }
  return false;
}

VoxelSet SetOf(const LocalVoxels& voxels) {
  VoxelSet set;
  for (const auto& b : voxels.blocks) {
    for (uint32_t i = b.begin; i < b.end; ++i) set.insert(Key(VoxelAt(b.block, voxels.offset[i])));
  }
  return set;
}

TEST(ReleaseClaimed, ReleasesWhatBruteForceDoes) {
  std::mt19937 rng(1);
  size_t seen = 0;
  for (int round = 0; round < 5; ++round) {
    const SurfaceMap map = RandomMap(rng);
    const LocalVoxels object = Voxels(RandomPoints(60, rng));
    const LocalVoxels returns = Voxels(RandomPoints(40, rng));
    const VoxelSet hit = SetOf(returns);
    VoxelSet expected;
    for (const auto& b : object.blocks) {
      for (uint32_t i = b.begin; i < b.end; ++i) {
        const VoxelIndex own = VoxelAt(b.block, object.offset[i]);
        if (Near(hit, own)) continue;
        const Eigen::Vector3d point =
            BlockOrigin(b.block, kVoxel) + object.centroid[i].cast<double>();
        for (int k = 0; k < 125; ++k) {
          const VoxelIndex v = own + VoxelIndex(k / 25 - 2, k / 5 % 5 - 2, k % 5 - 2);
          const float* weight = map.WeightBlock(BlockOf(v));
          if (!weight || weight[OffsetOf(v)] == 0 || Near(hit, v)) continue;
          const double to_point = (VoxelCentre(v, kVoxel) - point).norm();
          const double to_surface = std::abs(map.MeanBlock(BlockOf(v))[OffsetOf(v)]);
          if (std::abs(to_point - to_surface) <= kVoxel) expected.insert(Key(v));
        }
      }
    }
    VoxelSet released;
    const std::vector<ReleasedBlock> blocks = ReleaseClaimed(object, StaticReturns(returns), map);
    for (size_t i = 0; i < blocks.size(); ++i) {
      if (i > 0) {
        EXPECT_LT(blocks[i - 1].block, blocks[i].block);
      }
      for (int o = 0; o < kBlockVoxels; ++o) {
        if (clearance::Test(blocks[i].voxels, o)) released.insert(Key(VoxelAt(blocks[i].block, o)));
      }
    }
    EXPECT_EQ(released, expected);
    seen += expected.size();
  }
  EXPECT_GT(seen, 500u);
}

TEST(Dilated, GrowsAcrossBlockBordersAsBruteForceDoes) {
  std::mt19937 rng(2);
  for (int round = 0; round < 20; ++round) {
    std::array<BlockMask, 27> masks{};
    std::array<const BlockMask*, 27> around{};
    VoxelSet set;
    for (int k = 0; k < 27; ++k) {
      if (rng() % 4 == 0) continue;
      around[k] = &masks[k];
      for (int n = 0; n < 6; ++n) {
        const int o = static_cast<int>(rng() % kBlockVoxels);
        Set(masks[k], o);
        set.insert(Key(VoxelAt({k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1}, o)));
      }
    }
    const BlockMask grown = Dilated(around);
    for (int o = 0; o < kBlockVoxels; ++o) {
      ASSERT_EQ(clearance::Test(grown, o), Near(set, VoxelAt({0, 0, 0}, o))) << o;
    }
  }
}

}  // namespace
}  // namespace clearance
