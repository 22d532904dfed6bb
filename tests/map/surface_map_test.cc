#include "server/map/surface_map.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>

#include "server/map/free_evidence.h"
#include "server/map/observed_voxels.h"

namespace clearance {
namespace {

using Voxels = std::map<std::tuple<int, int, int>, std::pair<float, float>>;

// Voxels -> an update's band; keys are voxel indices, values (distance, weight).
BandObservations BandOf(const Voxels& voxels) {
  std::map<BlockIndex, std::map<int, std::pair<float, float>>> blocks;
  for (const auto& [key, value] : voxels) {
    const VoxelIndex v(std::get<0>(key), std::get<1>(key), std::get<2>(key));
    blocks[BlockOf(v)][OffsetOf(v)] = value;
  }
  BandObservations band;
  for (const auto& [block, observations] : blocks) {
    const uint32_t begin = band.offset.size();
    for (const auto& [offset, value] : observations) {
      band.offset.push_back(offset);
      band.distance_m.push_back(value.first);
      band.weight.push_back(value.second);
    }
    band.blocks.push_back({block, begin, static_cast<uint32_t>(band.offset.size())});
  }
  return band;
}

float MeanAt(const SurfaceMap& map, const VoxelIndex& v) {
  const float* block = map.MeanBlock(BlockOf(v));
  return block ? block[OffsetOf(v)] : 0;
}

float WeightAt(const SurfaceMap& map, const VoxelIndex& v) {
  const float* block = map.WeightBlock(BlockOf(v));
  return block ? block[OffsetOf(v)] : 0;
}

TEST(Voxel, IndexingRoundsDownOnBothSidesOfTheOriginAndFarFromIt) {
  EXPECT_EQ(VoxelOf({-0.05, -0.1001, 0.05}, 0.1), VoxelIndex(-1, -2, 0));
  EXPECT_EQ(BlockOf(VoxelIndex(-1, -8, -9)), (BlockIndex{-1, -1, -2}));
  std::mt19937 rng(1);
  std::uniform_int_distribution<int> u(-100'000'000, 100'000'000);
  for (int i = 0; i < 10000; ++i) {
    const VoxelIndex v(u(rng), u(rng), u(rng));
    EXPECT_EQ(VoxelOf(VoxelCentre(v, 0.1), 0.1), v);
    EXPECT_EQ(VoxelAt(BlockOf(v), OffsetOf(v)), v);
  }
}

TEST(SurfaceMap, FusesByTheRunningWeightedMeanUpToTheCap) {
  const FusionOptions options;
  SurfaceMap map(0.1);
  std::mt19937 rng(2);
  // Deeper than half a voxel behind a surface a mean is a guess, which what is seen overrules.
  std::uniform_real_distribution<float> distance(-0.05f, 0.2f), weight(0.05f, 1.f);
  std::uniform_int_distribution<int> index(-20, 20);
  std::map<std::tuple<int, int, int>, std::pair<double, double>> truth;  // sum w d, sum w
  for (int frame = 0; frame < 15; ++frame) {
    Voxels voxels;
    for (int i = 0; i < 300; ++i) {
      voxels[{index(rng), index(rng), index(rng)}] = {distance(rng), weight(rng)};
    }
    SurfaceUpdate update;
    update.band = BandOf(voxels);
    map.Apply(update, options);
    for (const auto& [key, value] : voxels) {
      truth[key].first += double(value.first) * value.second;
      truth[key].second += value.second;
    }
  }
  for (const auto& [key, sums] : truth) {
    const VoxelIndex v(std::get<0>(key), std::get<1>(key), std::get<2>(key));
    ASSERT_LT(sums.second, options.max_weight);
    EXPECT_NEAR(MeanAt(map, v), sums.first / sums.second, 1e-5);
    EXPECT_NEAR(WeightAt(map, v), sums.second, 1e-4);
  }
}

TEST(SurfaceMap, WhatWasSeenOutweighsGuessesFromBehind) {
  const FusionOptions options;
  SurfaceMap map(0.1);
  const std::tuple<int, int, int> key{-3, 5, -9};
  const VoxelIndex v(-3, 5, -9);
  const auto see = [&](float d, float weight) {
    SurfaceUpdate update;
    update.band = BandOf({{key, {d, weight}}});
    map.Apply(update, options);
  };
  see(-0.12f, 2.f);
  see(0.03f, 0.1f);
  EXPECT_LT(MeanAt(map, v), -0.1) << "too weak to tell";
  see(0.03f, 0.5f);
  EXPECT_FLOAT_EQ(MeanAt(map, v), 0.03f);
  EXPECT_FLOAT_EQ(WeightAt(map, v), 0.5f);
  see(-0.04f, 0.5f);
  EXPECT_NEAR(MeanAt(map, v), -0.005, 1e-6) << "a look at the surface itself is no guess";
}

TEST(SurfaceMap, CapLetsASurfaceMove) {
  const FusionOptions options;
  SurfaceMap map(0.1);
  SurfaceUpdate update;
  update.band = BandOf({{{-3, 5, -9}, {0.1f, 1.f}}});
  for (int i = 0; i < 200; ++i) map.Apply(update, options);
  EXPECT_FLOAT_EQ(WeightAt(map, {-3, 5, -9}), options.max_weight);
  update.band.distance_m[0] = -0.1f;
  for (int i = 0; i < 20; ++i) map.Apply(update, options);
  EXPECT_LT(MeanAt(map, {-3, 5, -9}), 0);
}

TEST(SurfaceMap, ReleasedSurfaceIsGoneBeforeTheFramesOwnBandIsFused) {
  SurfaceMap map(0.1);
  SurfaceUpdate update;
  update.band = BandOf({{{1, 2, 3}, {0.1f, 1.f}}, {{1, 2, 4}, {0.05f, 1.f}}});
  for (int i = 0; i < 10; ++i) map.Apply(update, {});
  SurfaceUpdate release;
  release.released.push_back({BlockIndex{0, 0, 0}, {}});
  Set(release.released[0].voxels, OffsetOf({1, 2, 3}));
  Set(release.released[0].voxels, OffsetOf({1, 2, 4}));
  release.band = BandOf({{{1, 2, 4}, {-0.02f, 0.5f}}});
  map.Apply(release, {});
  EXPECT_EQ(WeightAt(map, {1, 2, 3}), 0);
  EXPECT_FLOAT_EQ(WeightAt(map, {1, 2, 4}), 0.5f);
  EXPECT_FLOAT_EQ(MeanAt(map, {1, 2, 4}), -0.02f);
}

TEST(SurfaceMap, RefutedSurfaceVanishesHoweverOftenItWasSeenAndContradictedSurfaceStays) {
  SurfaceMap map(0.1);
  SurfaceUpdate seen;
  seen.band = BandOf({{{-1, -1, -1}, {0.01f, 1.f}}});
  for (int i = 0; i < 100; ++i) map.Apply(seen, {});
  SurfaceUpdate through;
  through.free.push_back({BlockIndex{-1, -1, -1}, {}, {}, {}});
  Set(through.free[0].contradicted, OffsetOf({-1, -1, -1}));
  Set(through.free[0].probable, OffsetOf({-1, -1, -1}));
  map.Apply(through, {});
  EXPECT_GT(WeightAt(map, {-1, -1, -1}), 0);
  Set(through.free[0].refuted, OffsetOf({-1, -1, -1}));
  map.Apply(through, {});
  EXPECT_EQ(WeightAt(map, {-1, -1, -1}), 0);
}

TEST(SurfaceMap, GuessesBesideASurfaceDoNotOverruleRaysThatWentThrough) {
  SurfaceMap map(0.1);
  SurfaceUpdate free;
  free.free.push_back({BlockIndex{-1, 0, 0}, {}, {}, {}});
  Set(free.free[0].probable, OffsetOf({-2, 3, 1}));
  SurfaceUpdate guess, sight, near;
  guess.band = BandOf({{{-2, 3, 1}, {0.03f, 0.36f}}, {{-2, 3, 2}, {0.03f, 0.36f}}});
  sight.band = BandOf({{{-2, 3, 1}, {0.03f, 0.8f}}});
  map.Apply(free, {});
  map.Apply(free, {});
  map.Apply(guess, {});
  EXPECT_GT(WeightAt(map, {-2, 3, 1}), 0) << "two frames are not enough";
  SurfaceMap again(0.1);
  for (int i = 0; i < 3; ++i) again.Apply(free, {});
  for (int i = 0; i < 4; ++i) again.Apply(guess, {});
  EXPECT_EQ(WeightAt(again, {-2, 3, 1}), 0);
  EXPECT_GT(WeightAt(again, {-2, 3, 2}), 0) << "no ray went through this one";
  again.Apply(sight, {});
  EXPECT_FLOAT_EQ(WeightAt(again, {-2, 3, 1}), 0.8f) << "what was measured nearby counts";
  again.Apply(guess, {});
  EXPECT_GT(WeightAt(again, {-2, 3, 1}), 0.8f) << "and guesses add to it";
}

TEST(SurfaceMap, WholeFreeBlocksCollapseToATileAndReportChangesOnlyWhenTheirStateChanges) {
  SurfaceMap map(0.1);
  SurfaceUpdate free;
  free.free.push_back({BlockIndex{-2, 7, 0}, kFullMask, kFullMask, {}});
  int changes = 0;
  for (int i = 0; i < 2 * kSaturatedFrames; ++i) changes += map.Apply(free, {}).size();
  EXPECT_GE(changes, 1);
  EXPECT_LE(changes, 3);
  const uint64_t tile_bytes = map.MemoryBytes();
  std::vector<int32_t> evidence(kHaloVoxels);
  map.ReadEvidence({-2, 7, 0}, evidence.data());
  EXPECT_EQ(FreeEvidence::Unpack(evidence[HaloOffset(3, 3, 3)]).confident, kSaturatedFrames);
  EXPECT_TRUE(IsFree(FreeEvidence::Unpack(evidence[HaloOffset(0, 7, 7)])));
  EXPECT_EQ(evidence[HaloOffset(-1, 0, 0)], 0);
  // A surface behind which the tile lies has to prove its freedom anew.
  SurfaceUpdate parked;
  parked.band = BandOf({{{-12, 60, 3}, {-0.1f, 1.f}}});
  for (int i = 0; i < 8; ++i) map.Apply(parked, {});
  map.ReadEvidence({-2, 7, 0}, evidence.data());
  EXPECT_FALSE(IsFree(FreeEvidence::Unpack(evidence[HaloOffset(4, 4, 3)])));
  EXPECT_TRUE(IsFree(FreeEvidence::Unpack(evidence[HaloOffset(4, 4, 4)])));
  EXPECT_GT(map.MemoryBytes(), tile_bytes);
}

TEST(SurfaceMap, HaloReadsEqualSingleReadsAcrossBlockBorders) {
  SurfaceMap map(0.2);
  std::mt19937 rng(3);
  std::uniform_int_distribution<int> index(-12, 12);
  Voxels voxels;
  for (int i = 0; i < 4000; ++i) {
    voxels[{index(rng), index(rng), index(rng)}] = {0.001f * i, 0.5f};
  }
  SurfaceUpdate update;
  update.band = BandOf(voxels);
  map.Apply(update, {});
  std::vector<float> mean(kHaloVoxels), weight(kHaloVoxels);
  for (const BlockIndex& block : {BlockIndex{-1, -1, -1}, BlockIndex{0, -1, 0}}) {
    map.ReadBand(block, mean.data(), weight.data());
    for (int x = -1; x <= 8; ++x) {
      for (int y = -1; y <= 8; ++y) {
        for (int z = -1; z <= 8; ++z) {
          const VoxelIndex v = FirstVoxel(block) + VoxelIndex(x, y, z);
          EXPECT_EQ(mean[HaloOffset(x, y, z)], MeanAt(map, v));
          EXPECT_EQ(weight[HaloOffset(x, y, z)], WeightAt(map, v));
        }
      }
    }
  }
}

TEST(SurfaceMap, ObservedMasksSayWhereBandAndEvidenceAre) {
  SurfaceMap map(0.1);
  std::mt19937 rng(7);
  std::uniform_int_distribution<int> index(-12, 12);
  for (int step = 0; step < 40; ++step) {
    SurfaceUpdate update;
    Voxels voxels;
    for (int i = 0; i < 60; ++i) voxels[{index(rng), index(rng), index(rng)}] = {0.01f, 0.5f};
    update.band = BandOf(voxels);
    update.free.push_back({BlockIndex{-1, -1, -1}, kFullMask, kFullMask, {}});  // becomes a tile
    FreeBlock some{BlockIndex{0, 0, -1}, {}, {}, {}};
    for (int i = 0; i < 20; ++i) {
      Set(some.probable, static_cast<int>(rng() % kBlockVoxels));
      Set(some.contradicted, static_cast<int>(rng() % kBlockVoxels));
    }
    some.refuted = some.contradicted;
    update.free.push_back(some);
    if (step > 5) update.band = {};
    map.Apply(update, {});
    if (step == 30) {
      const Aabb box(Eigen::Vector3d(-0.6, -0.6, -0.6), Eigen::Vector3d(0.3, 0.3, 0.3));
      map.Edit(RegionAction::kClearToUnknown, box, [](const auto&) { return 0.0; }, 0.2, {});
    }
    for (const BlockIndex& block : {BlockIndex{-1, -1, -1}, BlockIndex{0, 0, -1}}) {
      ObservedVoxels observed;
      ReadObserved(map, block, &observed);
      std::vector<float> mean(kHaloVoxels), weight(kHaloVoxels);
      std::vector<int32_t> evidence(kHaloVoxels), own(kBlockVoxels);
      map.ReadBand(block, mean.data(), weight.data());
      map.ReadEvidence(block, evidence.data());
      ReadOwnEvidence(map, block, own.data());
      for (int x = -1; x <= 8; ++x) {
        for (int y = -1; y <= 8; ++y) {
          for (int z = -1; z <= 8; ++z) {
            const int h = HaloOffset(x, y, z), o = OffsetOf({x, y, z});
            const BlockIndex b = BlockOf({x, y, z});
            const BlockMask& mask = observed.any[(b.x + 1) * 9 + (b.y + 1) * 3 + b.z + 1];
            ASSERT_EQ(clearance::Test(mask, o), evidence[h] != 0 || weight[h] > 0) << step;
            if (b != BlockIndex{}) continue;
            ASSERT_EQ(clearance::Test(observed.band, o), weight[h] > 0) << step;
            ASSERT_EQ(own[o], evidence[h]) << step;
          }
        }
      }
    }
  }
}

TEST(SurfaceMap, EditsOccupiedFreeAndUnknownRegions) {
  SurfaceMap map(0.1);
  const Aabb ball(Eigen::Vector3d(-1, -1, -1), Eigen::Vector3d(1, 1, 1));
  const auto sdf = [](const Eigen::Vector3d& p) { return p.norm() - 1; };
  map.Edit(RegionAction::kMarkOccupied, ball, sdf, 0.2, {});
  EXPECT_NEAR(MeanAt(map, VoxelOf({1.05, 0.05, 0.05}, 0.1)), sdf({1.05, 0.05, 0.05}), 1e-6);
  EXPECT_NEAR(MeanAt(map, {0, 0, 0}), -0.2, 1e-6);
  map.Edit(RegionAction::kMarkFree, ball, sdf, 0.2, {});
  EXPECT_EQ(WeightAt(map, {0, 0, 0}), 0);
  std::vector<int32_t> evidence(kHaloVoxels);
  map.ReadEvidence({0, 0, 0}, evidence.data());
  EXPECT_TRUE(IsFree(FreeEvidence::Unpack(evidence[HaloOffset(0, 0, 0)])));
  map.Edit(RegionAction::kClearToUnknown, ball, sdf, 0.2, {});
  map.ReadEvidence({0, 0, 0}, evidence.data());
  EXPECT_EQ(evidence[HaloOffset(0, 0, 0)], 0);
}

}  // namespace
}  // namespace clearance
