#include "server/esdf/voxel_state.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace clearance {
namespace {

constexpr float kH = 0.1f;
constexpr uint8_t kFree = static_cast<uint8_t>(VoxelState::kFree);
constexpr uint8_t kOccupied = static_cast<uint8_t>(VoxelState::kOccupied);

struct Halo {
  float mean[kHaloVoxels] = {}, weight[kHaloVoxels] = {};
  int32_t evidence[kHaloVoxels] = {};
  uint8_t states[kBlockVoxels];

  void Fill(FreeEvidence e) {
    for (int32_t& v : evidence) v = e.Pack();
  }
  // A wall: mean = x - position (voxels), weight 1, `reach` voxels about it.
  void Wall(double position, double reach) {
    for (int x = -1; x <= 8; ++x) {
      if (std::abs(x - position) > reach) continue;
      for (int i = 0; i < kHaloSide * kHaloSide; ++i) {
        mean[(x + 1) * kHaloSide * kHaloSide + i] = static_cast<float>(x - position) * kH;
        weight[(x + 1) * kHaloSide * kHaloSide + i] = 1;
      }
    }
  }
  void Classify() {
    BlockSites sites;
    ExtractSites(mean, weight, kH, 0.3f, &sites);
    ClassifyVoxels(mean, weight, evidence, sites, kH, 0.3f, states);
  }
  // As ReadObserved gives it: of the 26 blocks around only what touches this one.
  std::array<BlockMask, 27> Observed() const {
    std::array<BlockMask, 27> masks{};
    for (int x = -1; x <= 8; ++x) {
      for (int y = -1; y <= 8; ++y) {
        for (int z = -1; z <= 8; ++z) {
          const int h = HaloOffset(x, y, z);
          if (evidence[h] == 0 && weight[h] == 0) continue;
          const BlockIndex b = BlockOf({x, y, z});
          Set(masks[(b.x + 1) * 9 + (b.y + 1) * 3 + b.z + 1], OffsetOf({x, y, z}));
        }
      }
    }
    return masks;
  }
  std::array<int32_t, kBlockVoxels> OwnEvidence() const {
    std::array<int32_t, kBlockVoxels> own;
    for (int o = 0; o < kBlockVoxels; ++o) {
      own[o] = evidence[HaloOffset(o >> 6, (o >> 3) & 7, o & 7)];
    }
    return own;
  }
  uint8_t At(int x, int y = 4, int z = 4) const { return states[x << 6 | y << 3 | z]; }
};

constexpr FreeEvidence kSure{10, 10, 0, 0}, kOnce{0, 1, 0, 0};

TEST(VoxelState, IsUnknownWithoutObservation) {
  Halo halo;
  halo.Classify();
  for (uint8_t s : halo.states) EXPECT_EQ(s, 0);
}

TEST(VoxelState, IsFreeAtHighConfidenceWhereNeighboursWereObserved) {
  Halo halo;
  halo.Fill(kSure);
  halo.Classify();
  for (uint8_t s : halo.states) EXPECT_EQ(s, kFree);
}

TEST(VoxelState, HasLowConfidenceBesideAnUnobservedVoxel) {
  Halo halo;
  halo.Fill(kSure);
  halo.evidence[HaloOffset(4, 4, 4)] = 0;
  halo.Classify();
  EXPECT_EQ(halo.At(4), 0);
  EXPECT_EQ(halo.At(3, 3, 3), kFree | kLowConfidenceBit);
  EXPECT_EQ(halo.At(5, 4, 4), kFree | kLowConfidenceBit);
  EXPECT_EQ(halo.At(2, 4, 4), kFree);
}

TEST(VoxelState, HasLowConfidenceWhenSeenFreeOnce) {
  Halo halo;
  halo.Fill(kOnce);
  halo.Classify();
  for (uint8_t s : halo.states) EXPECT_EQ(s, kFree | kLowConfidenceBit);
}

TEST(VoxelState, IsOccupiedWhereTheCubeContainsTheSurfaceWhateverWasSeenFree) {
  Halo halo;
  halo.Fill(kSure);
  halo.Wall(3.3, 2.0);
  halo.Classify();
  EXPECT_EQ(halo.At(3), kOccupied | kNegativeBit);  // centre 0.3 voxel inside
  EXPECT_EQ(halo.At(4), kFree);
  EXPECT_EQ(halo.At(2), kFree);  // evidence outranks a negative mean away from the surface
}

TEST(VoxelState, TakesTheSideFromTheMeanWhereNothingElseIsKnown) {
  Halo halo;
  halo.Wall(3.3, 2.0);
  halo.Classify();
  EXPECT_EQ(halo.At(0), 0);
  EXPECT_EQ(halo.At(2), kOccupied | kNegativeBit);
  EXPECT_EQ(halo.At(3), kOccupied | kNegativeBit);
  EXPECT_EQ(halo.At(4), kFree | kLowConfidenceBit);
  EXPECT_EQ(halo.At(5), kFree | kLowConfidenceBit);
  EXPECT_EQ(halo.At(6), 0);
}

TEST(VoxelState, MarksAnOccupiedCentreInFrontOfTheSurfaceAsOutside) {
  Halo halo;
  halo.Wall(2.8, 2.0);
  halo.Classify();
  EXPECT_EQ(halo.At(3), kOccupied);
}

TEST(VoxelState, ReachesIntoTheCornerOfACubeAlongADiagonalNormal) {
  Halo halo;
  // A plane with normal (1, 1, 1): it cuts a cube's corner up to 0.866 voxel from the centre.
  for (int x = -1; x <= 8; ++x) {
    for (int y = -1; y <= 8; ++y) {
      for (int z = -1; z <= 8; ++z) {
        const double d = (x + y + z - 12 + 1.4) / std::sqrt(3.0);  // (4, 4, 4): 0.81 voxel
        if (std::abs(d) > 2) continue;
        halo.mean[HaloOffset(x, y, z)] = static_cast<float>(d) * kH;
        halo.weight[HaloOffset(x, y, z)] = 1;
      }
    }
  }
  halo.Classify();
  EXPECT_EQ(halo.At(4), kOccupied);
  EXPECT_EQ(halo.At(4, 4, 5), kFree | kLowConfidenceBit);
}

TEST(VoxelState, AgreesWithTheRulesOfFreeEvidenceVoxelByVoxel) {
  std::mt19937 rng(1);
  for (int repeat = 0; repeat < 200; ++repeat) {
    Halo halo;
    const uint32_t holes = repeat % 4 ? 1 + rng() % 300 : 0;
    for (int i = 0; i < kHaloVoxels; ++i) {
      if (holes && rng() % holes == 0) {
        halo.weight[i] = rng() % 2 ? 0.1f : 0.f;
        continue;
      }
      const uint8_t probable = static_cast<uint8_t>(rng() % 6);
      halo.evidence[i] = FreeEvidence{static_cast<uint8_t>(rng() % (probable + 1)), probable,
                                      static_cast<uint8_t>(rng() % 2), 0}
                             .Pack();
    }
    ClassifyByEvidence(halo.OwnEvidence().data(), Surrounded(halo.Observed()), halo.states);
    for (int o = 0; o < kBlockVoxels; ++o) {
      const int h = HaloOffset(o >> 6, (o >> 3) & 7, o & 7);
      int expected = 0;
      if (IsFree(FreeEvidence::Unpack(halo.evidence[h]))) {
        expected =
            IsConfidentlyFree(halo.evidence, halo.weight, h) ? kFree : kFree | kLowConfidenceBit;
      }
      ASSERT_EQ(halo.states[o], expected) << repeat << " " << o;
    }
  }
}

TEST(VoxelState, IsTheSameFromMasksAndFromHalos) {
  std::mt19937 rng(2);
  for (int repeat = 0; repeat < 200; ++repeat) {
    Halo halo;
    const uint32_t holes = 1 + rng() % 400;
    for (int i = 0; i < kHaloVoxels; ++i) {
      if (rng() % holes != 0) halo.evidence[i] = kSure.Pack();
      if (rng() % holes == 0) halo.weight[i] = 1;
    }
    ASSERT_EQ(Surrounded(halo.Observed()), Surrounded(halo.weight, halo.evidence)) << repeat;
  }
}

TEST(VoxelState, IgnoresLightBandVoxels) {
  Halo halo;
  halo.Wall(3.3, 2.0);
  for (float& w : halo.weight) w *= 0.2f;
  halo.Classify();
  for (uint8_t s : halo.states) EXPECT_EQ(s, 0);
}

}  // namespace
}  // namespace clearance
