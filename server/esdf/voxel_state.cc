#include "server/esdf/voxel_state.h"

#include <cmath>

namespace clearance {
namespace {

constexpr uint8_t kFreeLow = static_cast<uint8_t>(VoxelState::kFree) | kLowConfidenceBit;
constexpr uint8_t kFreeHigh = static_cast<uint8_t>(VoxelState::kFree);
constexpr uint8_t kOccupied = static_cast<uint8_t>(VoxelState::kOccupied);

// No cube reaches farther along any normal: half its diagonal.
constexpr float kCubeReach = 0.867f;

// Half the cube's extent along the normal of the mean, in voxels: 0.5 |n|_1.
float ReachVoxels(const float* mean, const float* weight, int h, float voxel_size_m,
                  float min_weight) {
  const Eigen::Vector3f g = MeanGradient(mean, weight, h, voxel_size_m, min_weight);
  const float slope = g.norm();
  return slope > 0 ? 0.5f * g.lpNorm<1>() / slope : 0.5f;
}

// First and last column of an 8 x 8 layer (bits y * 8 + z).
constexpr uint64_t kFirstZ = 0x0101010101010101, kLastZ = 0x8080808080808080;

// Bits of a layer whose neighbours along z are set, too; `before` and `after` are the same layer of
// the blocks at either side.
uint64_t ErodeZ(uint64_t before, uint64_t own, uint64_t after) {
  const uint64_t below = ((own << 1) & ~kFirstZ) | ((before >> 7) & kFirstZ);
  const uint64_t above = ((own >> 1) & ~kLastZ) | ((after << 7) & kLastZ);
  return below & own & above;
}

uint64_t ErodeY(uint64_t before, uint64_t own, uint64_t after) {
  return (own << 8 | before >> 56) & own & (own >> 8 | after << 56);
}

}  // namespace

BlockMask Surrounded(const std::array<BlockMask, 27>& observed) {
  uint64_t layers[10];  // eroded along z and y; x from -1 to 8
  for (int x = -1; x <= 8; ++x) {
    const int bx = x < 0 ? 0 : (x < 8 ? 1 : 2);
    uint64_t rows[3];
    for (int by = 0; by < 3; ++by) {
      const BlockMask* run = &observed[bx * 9 + by * 3];
      rows[by] = ErodeZ(run[0][x & 7], run[1][x & 7], run[2][x & 7]);
    }
    layers[x + 1] = ErodeY(rows[0], rows[1], rows[2]);
  }
  BlockMask surrounded;
  for (int x = 0; x < 8; ++x) surrounded[x] = layers[x] & layers[x + 1] & layers[x + 2];
  return surrounded;
}

BlockMask Surrounded(const float weight[kHaloVoxels], const int32_t evidence[kHaloVoxels]) {
  BlockMask surrounded{};
  for (int o = 0; o < kBlockVoxels; ++o) {
    const int x = o >> 6, y = (o >> 3) & 7, z = o & 7;
    bool all = true;
    for (int n = 0; n < 27 && all; ++n) {
      const int h = HaloOffset(x + n / 9 - 1, y + n / 3 % 3 - 1, z + n % 3 - 1);
      all = evidence[h] != 0 || weight[h] > 0;
    }
    if (all) Set(surrounded, o);
  }
  return surrounded;
}

void ClassifyByEvidence(const int32_t evidence[kBlockVoxels], const BlockMask& surrounded,
                        uint8_t states[kBlockVoxels]) {
  constexpr FreeRules kRules;
  for (int row = 0; row < 64; ++row) {
    const uint32_t inner = static_cast<uint32_t>(surrounded[row >> 3] >> (row & 7) * 8) & 255;
    for (int z = 0; z < 8; ++z) {
      const uint32_t e = static_cast<uint32_t>(evidence[row * 8 + z]);
      const bool free = ((e >> 8) & 255) >= kRules.min_probable_frames;
      const bool sure = (e & 255) >= kRules.min_confident_frames && (inner >> z & 1) != 0;
      states[row * 8 + z] = free ? (sure ? kFreeHigh : kFreeLow) : 0;
    }
  }
}

void ClassifyVoxels(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                    const int32_t evidence[kHaloVoxels], const BlockSites& sites,
                    float voxel_size_m, float min_weight, uint8_t states[kBlockVoxels]) {
  int32_t own[kBlockVoxels];
  for (int o = 0; o < kBlockVoxels; ++o) own[o] = evidence[HaloOffset(o >> 6, (o >> 3) & 7, o & 7)];
  ClassifyByEvidence(own, Surrounded(weight, evidence), states);
  ClassifyBand(mean, weight, sites, voxel_size_m, min_weight, states);
}

void ClassifyBand(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                  const BlockSites& sites, float voxel_size_m, float min_weight,
                  uint8_t states[kBlockVoxels]) {
  for (int o = 0; o < kBlockVoxels; ++o) {
    const int h = HaloOffset(o >> 6, (o >> 3) & 7, o & 7);
    if (!(weight[h] >= min_weight)) continue;
    const float m = mean[h] / voxel_size_m;
    const uint8_t occupied = m < 0 ? kOccupied | kNegativeBit : kOccupied;
    if (Test(sites.mask, o) ||
        (std::abs(m) <= kCubeReach &&
         std::abs(m) <= ReachVoxels(mean, weight, h, voxel_size_m, min_weight))) {
      states[o] = occupied;
    } else if (states[o] == 0) {
      states[o] = m < 0 ? occupied : kFreeLow;
    }
  }
}

}  // namespace clearance
