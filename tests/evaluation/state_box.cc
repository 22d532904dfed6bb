#include "tests/evaluation/state_box.h"

#include <vector>

#include "server/esdf/voxel_state.h"

namespace clearance::evaluation {

void ComposeStates(const SurfaceMap& map, const FusionOptions& fusion,
                   VoxelBox<StateOfVoxel>& box) {
  const BlockIndex low = BlockOf(box.low());
  const BlockIndex high = BlockOf(box.VoxelOfIndex(box.size() - 1));
  const float h = static_cast<float>(map.voxel_size_m());
  std::vector<float> mean(kHaloVoxels), weight(kHaloVoxels);
  std::vector<int32_t> evidence(kHaloVoxels);
  BlockSites sites;
  uint8_t states[kBlockVoxels];
  for (int x = low.x; x <= high.x; ++x) {
    for (int y = low.y; y <= high.y; ++y) {
      for (int z = low.z; z <= high.z; ++z) {
        const BlockIndex block{x, y, z};
        map.ReadBand(block, mean.data(), weight.data());
        map.ReadEvidence(block, evidence.data());
        ExtractSites(mean.data(), weight.data(), h, fusion.min_weight, &sites);
        ClassifyVoxels(mean.data(), weight.data(), evidence.data(), sites, h, fusion.min_weight,
                       states);
        for (int o = 0; o < kBlockVoxels; ++o) {
          StateOfVoxel* out = box.Find(VoxelAt(block, o));
          if (!out) continue;
          const auto state = static_cast<VoxelState>(states[o] & kStateBits);
          out->known = state == VoxelState::kOccupied ? Known::kOccupied
                       : state == VoxelState::kFree   ? Known::kFree
                                                      : Known::kUnknown;
          out->confident = (states[o] & kLowConfidenceBit) == 0;
        }
      }
    }
  }
}

}  // namespace clearance::evaluation
