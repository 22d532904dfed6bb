#include "server/esdf/voxel_state.h"

#include <cmath>

namespace clearance {
namespace {

constexpr uint8_t kFreeLow = static_cast<uint8_t>(VoxelState::kFree) | kLowConfidenceBit;
constexpr uint8_t kFreeHigh = static_cast<uint8_t>(VoxelState::kFree);
constexpr uint8_t kOccupied = static_cast<uint8_t>(VoxelState::kOccupied);

// Half the cube's extent along the normal of the mean, in voxels: 0.5 |n|_1.
float ReachVoxels(const float* mean, const float* weight, int h, float voxel_size_m,
                  float min_weight) {
  const Eigen::Vector3f g = MeanGradient(mean, weight, h, voxel_size_m, min_weight);
  const float slope = g.norm();
  return slope > 0 ? 0.5f * g.lpNorm<1>() / slope : 0.5f;
}

}  // namespace

void ClassifyVoxels(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                    const int32_t evidence[kHaloVoxels], const BlockSites& sites,
                    float voxel_size_m, float min_weight, uint8_t states[kBlockVoxels]) {
  for (int o = 0; o < kBlockVoxels; ++o) {
    const int h = HaloOffset(o >> 6, (o >> 3) & 7, o & 7);
    const bool fused = weight[h] >= min_weight;
    const float m = mean[h] / voxel_size_m;
    const uint8_t inside = fused && m < 0 ? kNegativeBit : 0;
    if (fused && (Test(sites.mask, o) ||
                  (std::abs(m) <= 0.87f &&
                   std::abs(m) <= ReachVoxels(mean, weight, h, voxel_size_m, min_weight)))) {
      states[o] = kOccupied | inside;
    } else if (IsFree(FreeEvidence::Unpack(evidence[h]))) {
      states[o] = IsConfidentlyFree(evidence, weight, h) ? kFreeHigh : kFreeLow;
    } else if (fused) {
      states[o] = m < 0 ? kOccupied | inside : kFreeLow;
    } else {
      states[o] = 0;
    }
  }
}

}  // namespace clearance
