#include "server/esdf/sweep.h"

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <random>

#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

constexpr int32_t kLimit = 30 * 256 * 30 * 256;

// Blocks about the origin with sites that exist somewhere within the limit, each voxel naming one
// of them or none.
struct Neighbourhood {
  FieldBlock block;
  std::array<std::unique_ptr<FieldBlock>, kFaces> neighbours;

  std::array<const FieldBlock*, kFaces> pointers() const {
    std::array<const FieldBlock*, kFaces> p{};
    for (int f = 0; f < kFaces; ++f) p[f] = neighbours[f].get();
    return p;
  }
};

void FillRandomly(std::mt19937& rng, const std::vector<Eigen::Vector3i>& sites,
                  const Eigen::Vector3i& first, double share, FieldBlock* block) {
  std::uniform_real_distribution<double> u(0, 1);
  for (int o = 0; o < kBlockVoxels; ++o) {
    FieldVoxel& v = block->voxels[o];
    v = {};
    v.attributes = static_cast<uint16_t>(rng() & kVoxelBits);
    if (u(rng) > share) continue;
    const size_t i = rng() % sites.size();
    const Eigen::Vector3i d =
        sites[i] - 256 * (first + Eigen::Vector3i(o >> 6, (o >> 3) & 7, o & 7));
    if (d.cast<double>().squaredNorm() > kLimit) continue;
    v.dx = static_cast<int16_t>(d.x());
    v.dy = static_cast<int16_t>(d.y());
    v.dz = static_cast<int16_t>(d.z());
    v.attributes |= static_cast<uint16_t>((i % 4096) << 4);  // the site's number, in its own bits
  }
}

Neighbourhood RandomNeighbourhood(uint32_t seed) {
  std::mt19937 rng(seed);
  std::uniform_int_distribution<int> u(-24 * 256, 32 * 256);
  std::vector<Eigen::Vector3i> sites(1 + rng() % 20);
  for (auto& s : sites) s = {u(rng), u(rng), u(rng)};
  Neighbourhood n;
  const double shares[] = {0, 0.05, 0.5, 1};
  FillRandomly(rng, sites, Eigen::Vector3i::Zero(), shares[rng() % 4], &n.block);
  for (int f = 0; f < kFaces; ++f) {
    if (rng() % 4 == 0) continue;
    n.neighbours[f] = std::make_unique<FieldBlock>();
    const Eigen::Vector3i first(8 * kFaceStep[f][0], 8 * kFaceStep[f][1], 8 * kFaceStep[f][2]);
    FillRandomly(rng, sites, first, shares[rng() % 4], n.neighbours[f].get());
  }
  return n;
}

// The voxel at (x, y, z), each -1..8, or nullptr outside (edges, absent neighbours).
const FieldVoxel* VoxelOfNeighbourhood(const Neighbourhood& n, const FieldBlock& block, int x,
                                       int y, int z) {
  const int at[3] = {x, y, z};
  int outside = -1;
  for (int a = 0; a < 3; ++a) {
    if (at[a] >= 0 && at[a] < 8) continue;
    if (outside >= 0) return nullptr;
    outside = 2 * a + (at[a] > 0);
  }
  const FieldBlock* b = outside < 0 ? &block : n.neighbours[outside].get();
  return b ? &b->voxels[(x & 7) << 6 | (y & 7) << 3 | (z & 7)] : nullptr;
}

// Squared length of `v`'s vector seen from the voxel that lies `step` further; above the limit
// without a site.
int64_t SeenFrom(const FieldVoxel& v, const int step[3]) {
  if (!v.has_site()) return int64_t{1} << 40;
  const int64_t x = v.dx - 256 * step[0], y = v.dy - 256 * step[1], z = v.dz - 256 * step[2];
  return x * x + y * y + z * z;
}

int64_t Length(const FieldVoxel& v) {
  const int none[3] = {};
  return SeenFrom(v, none);
}

TEST(SweepBlock, LeavesNoVoxelThatAFaceNeighbourCouldImprove) {
  for (uint32_t seed = 0; seed < 300; ++seed) {
    const Neighbourhood n = RandomNeighbourhood(seed);
    FieldBlock swept = n.block;
    SweepBlock(n.pointers(), kLimit, &swept);
    for (int o = 0; o < kBlockVoxels; ++o) {
      const int64_t length = Length(swept.voxels[o]);
      for (int f = 0; f < kFaces; ++f) {
        const FieldVoxel* other =
            VoxelOfNeighbourhood(n, swept, (o >> 6) + kFaceStep[f][0],
                                 ((o >> 3) & 7) + kFaceStep[f][1], (o & 7) + kFaceStep[f][2]);
        if (!other) continue;
        const int back[3] = {-kFaceStep[f][0], -kFaceStep[f][1], -kFaceStep[f][2]};
        const int64_t offered = SeenFrom(*other, back);
        EXPECT_FALSE(offered <= kLimit && offered < length) << seed << " " << o << " " << f;
      }
    }
  }
}

TEST(SweepBlock, OnlyEverBringsSitesNearerAndWithinTheLimit) {
  for (uint32_t seed = 0; seed < 300; ++seed) {
    const Neighbourhood n = RandomNeighbourhood(seed);
    FieldBlock swept = n.block;
    const bool changed = SweepBlock(n.pointers(), kLimit, &swept).changed;
    EXPECT_EQ(changed, swept.voxels != n.block.voxels);
    for (int o = 0; o < kBlockVoxels; ++o) {
      const FieldVoxel &before = n.block.voxels[o], &after = swept.voxels[o];
      EXPECT_LE(Length(after), Length(before));
      if (after.has_site()) {
        EXPECT_LE(Length(after), kLimit);
      }
      EXPECT_EQ(after.attributes & kVoxelBits, before.attributes & kVoxelBits);
    }
  }
}

TEST(SweepBlock, CarriesASitesAttributesWithItsPosition) {
  for (uint32_t seed = 0; seed < 100; ++seed) {
    const Neighbourhood n = RandomNeighbourhood(seed);
    // Position in the neighbourhood -> attributes, from everything that was stored before.
    std::map<std::array<int, 3>, uint16_t> known;
    const auto position = [](const FieldVoxel& v, int o, const int first[3]) {
      return std::array<int, 3>{v.dx + 256 * (first[0] + (o >> 6)),
                                v.dy + 256 * (first[1] + ((o >> 3) & 7)),
                                v.dz + 256 * (first[2] + (o & 7))};
    };
    const auto remember = [&](const FieldBlock& b, const int first[3]) {
      for (int o = 0; o < kBlockVoxels; ++o) {
        if (!b.voxels[o].has_site()) continue;
        known[position(b.voxels[o], o, first)] = b.voxels[o].attributes & kSiteBits;
      }
    };
    const int origin[3] = {};
    remember(n.block, origin);
    for (int f = 0; f < kFaces; ++f) {
      const int first[3] = {8 * kFaceStep[f][0], 8 * kFaceStep[f][1], 8 * kFaceStep[f][2]};
      if (n.neighbours[f]) remember(*n.neighbours[f], first);
    }
    FieldBlock swept = n.block;
    SweepBlock(n.pointers(), kLimit, &swept);
    for (int o = 0; o < kBlockVoxels; ++o) {
      const FieldVoxel& v = swept.voxels[o];
      if (!v.has_site()) continue;
      const auto it = known.find(position(v, o, origin));
      ASSERT_NE(it, known.end()) << seed << " " << o;
      EXPECT_EQ(v.attributes & kSiteBits, it->second);
    }
  }
}

TEST(SweepBlock, WakesExactlyTheNeighboursThatItCanImprove) {
  for (uint32_t seed = 0; seed < 300; ++seed) {
    const Neighbourhood n = RandomNeighbourhood(seed);
    FieldBlock swept = n.block;
    const uint8_t wake = SweepBlock(n.pointers(), kLimit, &swept).wake;
    for (int f = 0; f < kFaces; ++f) {
      bool improves = false;
      for (int o = 0; o < kBlockVoxels; ++o) {
        const int at[3] = {o >> 6, (o >> 3) & 7, o & 7};
        if (at[f >> 1] != (f & 1 ? 7 : 0)) continue;
        const int64_t offered = SeenFrom(swept.voxels[o], kFaceStep[f]);
        const FieldVoxel* other = VoxelOfNeighbourhood(
            n, swept, at[0] + kFaceStep[f][0], at[1] + kFaceStep[f][1], at[2] + kFaceStep[f][2]);
        improves |= offered <= kLimit && (!other || offered < Length(*other));
      }
      EXPECT_EQ(wake >> f & 1, improves) << seed << " face " << f;
    }
  }
}

TEST(SweepBlock, HoldsAtTheLargestDistance) {
  // 120 voxels is as far as offsets reach; one voxel more must not wrap around.
  const int32_t limit = SquaredLimit(12.0, 0.1);
  FieldBlock west, block;
  for (int o = 0; o < kBlockVoxels; ++o) {
    west.voxels[o] = {static_cast<int16_t>(-256 * (112 + (o >> 6)) - 128), 0, 0, 16};
  }
  std::array<const FieldBlock*, kFaces> neighbours{};
  neighbours[0] = &west;
  const SweepResult result = SweepBlock(neighbours, limit, &block);
  EXPECT_FALSE(block.voxels[0].has_site());  // 120.5 voxels
  EXPECT_FALSE(result.changed);
  for (FieldVoxel& v : west.voxels) v.dx = static_cast<int16_t>(v.dx + 256);
  SweepBlock(neighbours, limit, &block);
  EXPECT_TRUE(block.voxels[0].has_site());  // 119.5 voxels
  EXPECT_EQ(block.voxels[0].dx, -30592);
  EXPECT_FALSE(block.voxels[64].has_site());
}

}  // namespace
}  // namespace clearance
