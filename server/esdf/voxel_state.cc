#include "server/esdf/voxel_state.h"

#include <cmath>
#include <cstring>

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

// 1 where a voxel and its 26 neighbours were observed; valid for offsets inside 0..7.
void ErodeObserved(const float* weight, const int32_t* evidence, uint8_t out[kHaloVoxels]) {
  constexpr int kStride[3] = {1, kHaloSide, kHaloSide * kHaloSide};
  uint8_t a[kHaloVoxels], b[kHaloVoxels];
  for (int i = 0; i < kHaloVoxels; ++i) {
    a[i] = static_cast<uint8_t>((evidence[i] != 0) | (weight[i] > 0.f));
  }
  const auto erode = [](const uint8_t* from, uint8_t* to, int step) {
    for (int i = step; i < kHaloVoxels - step; ++i) {
      to[i] = from[i - step] & from[i] & from[i + step];
    }
  };
  std::memset(b, 0, sizeof(b));
  std::memset(out, 0, kHaloVoxels);
  erode(a, b, kStride[0]);
  erode(b, a, kStride[1]);
  erode(a, out, kStride[2]);
}

}  // namespace

void ClassifyByEvidence(const float weight[kHaloVoxels], const int32_t evidence[kHaloVoxels],
                        uint8_t states[kBlockVoxels]) {
  constexpr FreeRules kRules;
  uint8_t observed[kHaloVoxels];
  ErodeObserved(weight, evidence, observed);
  for (int row = 0; row < 64; ++row) {
    const int h = HaloOffset(row >> 3, row & 7, 0);
    for (int z = 0; z < 8; ++z) {
      const uint32_t e = static_cast<uint32_t>(evidence[h + z]);
      const bool free = ((e >> 8) & 255) >= kRules.min_probable_frames;
      const bool sure = (e & 255) >= kRules.min_confident_frames && observed[h + z];
      states[row * 8 + z] = free ? (sure ? kFreeHigh : kFreeLow) : 0;
    }
  }
}

void ClassifyVoxels(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                    const int32_t evidence[kHaloVoxels], const BlockSites& sites,
                    float voxel_size_m, float min_weight, uint8_t states[kBlockVoxels]) {
  ClassifyByEvidence(weight, evidence, states);
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
