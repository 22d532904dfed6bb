#include "server/integration/block_table.h"

namespace clearance {
namespace {

std::array<BlockMask, 27> MakeRimMasks(int reach) {
  std::array<BlockMask, 27> masks{};
  for (int k = 0; k < 27; ++k) {
    const Eigen::Vector3i step = StepAround(k) * kBlockSide;
    for (int o = 0; o < kBlockVoxels; ++o) {
      const VoxelIndex v = VoxelAt({0, 0, 0}, o) + step;
      if (v.minCoeff() >= -reach && v.maxCoeff() < kBlockSide + reach) Set(masks[k], o);
    }
  }
  return masks;
}

}  // namespace

const std::array<BlockMask, 27>& RimMasks(int reach) {
  static const auto masks = [] {
    std::array<std::array<BlockMask, 27>, kBlockSide + 1> all;
    for (int r = 0; r <= kBlockSide; ++r) all[r] = MakeRimMasks(r);
    return all;
  }();
  return masks[reach];
}

}  // namespace clearance
