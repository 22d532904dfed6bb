#include "server/integration/nearest_surface.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/field/lanes.h"

namespace clearance {
namespace {

// Index distance between a voxel and a surface voxel whose centroid is within reach of its centre.
int ReachInVoxels(float reach_voxels) {
  return std::clamp(static_cast<int>(std::floor(reach_voxels + 0.5f)), 1, kBlockSide);
}

// Lowest and highest coordinates of a set that is not empty.
std::pair<Eigen::Array3i, Eigen::Array3i> Extent(const BlockMask& mask) {
  Eigen::Array3i low(kBlockSide, 0, 0), high(-1, 0, 0);
  uint64_t layer = 0;  // bits y * 8 + z
  for (int x = 0; x < kBlockSide; ++x) {
    if (mask[x] == 0) continue;
    low.x() = std::min(low.x(), x);
    high.x() = x;
    layer |= mask[x];
  }
  uint64_t row = layer | layer >> 32;
  row |= row >> 16;
  row = (row | row >> 8) & 0xff;
  low.y() = __builtin_ctzll(layer) >> 3;
  high.y() = (63 - __builtin_clzll(layer)) >> 3;
  low.z() = __builtin_ctzll(row);
  high.z() = 63 - __builtin_clzll(row);
  return {low, high};
}

}  // namespace

std::vector<BlockIndex> BandBlocksOf(const LocalVoxels& voxels, const std::vector<BlockMask>& of,
                                     float reach_voxels) {
  const int reach = ReachInVoxels(reach_voxels);
  std::vector<BlockIndex> blocks;
  blocks.reserve(voxels.blocks.size() * 8);
  for (size_t k = 0; k < voxels.blocks.size(); ++k) {
    if (of[k] == BlockMask{}) continue;
    const LocalVoxels::Block& b = voxels.blocks[k];
    const auto [low, high] = Extent(of[k]);
    const Eigen::Array3i from = (low < reach).select(Eigen::Array3i(-1, -1, -1), 0);
    const Eigen::Array3i to = (high >= kBlockSide - reach).select(Eigen::Array3i(1, 1, 1), 0);
    for (int dx = from.x(); dx <= to.x(); ++dx) {
      for (int dy = from.y(); dy <= to.y(); ++dy) {
        for (int dz = from.z(); dz <= to.z(); ++dz) {
          blocks.push_back({b.block.x + dx, b.block.y + dy, b.block.z + dz});
        }
      }
    }
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

std::array<int32_t, kBlockVoxels> NearestSurface(const LocalVoxels& voxels, const BlockTable& table,
                                                 const std::vector<uint8_t>& skip,
                                                 const BlockIndex& block, float reach_voxels,
                                                 uint64_t rows) {
  constexpr Lanes kCentres = {0.5f, 1.5f, 2.5f, 3.5f, 4.5f, 5.5f, 6.5f, 7.5f};
  const int reach = ReachInVoxels(reach_voxels);
  const std::array<BlockMask, 27>& rims = RimMasks(reach);
  const float per_h = 1.f / static_cast<float>(voxels.voxel_size_m);
  std::array<Lanes, 64> best;  // squared distance in voxels; a row along z
  std::array<LanesInt, 64> nearest;
  best.fill(Splat(reach_voxels * reach_voxels));
  nearest.fill(LanesInt{} - 1);
  const std::array<int32_t, 27> around = table.Around(block);
  for (int k = 0; k < 27; ++k) {
    if (around[k] < 0) continue;
    const Eigen::Vector3i step = StepAround(k) * kBlockSide;
    for (uint32_t i = voxels.blocks[around[k]].begin; i < voxels.blocks[around[k]].end; ++i) {
      if (!Test(rims[k], voxels.offset[i]) || skip[i]) continue;
      const VoxelIndex v = VoxelAt({0, 0, 0}, voxels.offset[i]) + step;
      const Eigen::Vector3f c = voxels.centroid[i] * per_h + step.cast<float>();
      const int x0 = std::max(0, v.x() - reach), x1 = std::min(kBlockSide - 1, v.x() + reach);
      const int y0 = std::max(0, v.y() - reach), y1 = std::min(kBlockSide - 1, v.y() + reach);
      const Lanes dz = kCentres - c.z();
      const Lanes dz2 = dz * dz;
      for (int x = x0; x <= x1; ++x) {
        const float dx = static_cast<float>(x) + 0.5f - c.x();
        for (int y = y0; y <= y1; ++y) {
          const int row = x * kBlockSide + y;
          if (!(rows >> row & 1)) continue;
          const float dy = static_cast<float>(y) + 0.5f - c.y();
          const Lanes d2 = dz2 + (dx * dx + dy * dy);
          const LanesInt nearer = d2 < best[row];
          best[row] = Select(nearer, d2, best[row]);
          nearest[row] = nearer ? LanesInt{} + static_cast<int32_t>(i) : nearest[row];
        }
      }
    }
  }
  std::array<int32_t, kBlockVoxels> out;
  for (int row = 0; row < 64; ++row) {
    for (int z = 0; z < kBlockSide; ++z) out[row * kBlockSide + z] = nearest[row][z];
  }
  return out;
}

uint64_t RowsWithin(const BlockTable& table, const std::vector<BlockMask>& of,
                    const BlockIndex& block, float reach_voxels) {
  const int reach = ReachInVoxels(reach_voxels);
  const std::array<int32_t, 27> around = table.Around(block);
  uint64_t rows = 0;
  for (int k = 0; k < 27; ++k) {
    if (around[k] < 0) continue;
    const BlockMask& mask = of[around[k]];
    const Eigen::Vector3i step = StepAround(k) * kBlockSide;
    for (int layer = 0; layer < kBlockSide; ++layer) {
      if (mask[layer] == 0) continue;
      const int x = layer + step.x();
      const int x0 = std::max(0, x - reach), x1 = std::min(kBlockSide - 1, x + reach);
      if (x0 > x1) continue;
      uint32_t columns = 0;  // bits y of this block
      for (int y = 0; y < kBlockSide; ++y) {
        if ((mask[layer] >> (8 * y) & 0xff) == 0) continue;
        const int at = y + step.y();
        const int y0 = std::max(0, at - reach), y1 = std::min(kBlockSide - 1, at + reach);
        if (y0 <= y1) columns |= (2u << y1) - (1u << y0);
      }
      for (int i = x0; i <= x1; ++i) rows |= uint64_t{columns} << (8 * i);
    }
  }
  return rows;
}

}  // namespace clearance
