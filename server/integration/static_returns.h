// Which cubes hold static returns of this frame.
#pragma once

#include <algorithm>
#include <vector>

#include "server/integration/local_voxels.h"
#include "server/map/voxel.h"

namespace clearance {

class StaticReturns {
 public:
  explicit StaticReturns(const LocalVoxels& static_voxels) {
    blocks_.reserve(static_voxels.blocks.size());
    masks_.reserve(static_voxels.blocks.size());
    for (const LocalVoxels::Block& b : static_voxels.blocks) {
      blocks_.push_back(b.block);
      BlockMask& mask = masks_.emplace_back();
      for (uint32_t i = b.begin; i < b.end; ++i) Set(mask, static_voxels.offset[i]);
    }
  }

  // Sorted.
  const std::vector<BlockIndex>& blocks() const { return blocks_; }

  const BlockMask& In(const BlockIndex& block) const {
    static constexpr BlockMask kNone{};
    const auto it = std::lower_bound(blocks_.begin(), blocks_.end(), block);
    return it == blocks_.end() || *it != block ? kNone : masks_[it - blocks_.begin()];
  }
  bool Has(const VoxelIndex& v) const { return Test(In(BlockOf(v)), OffsetOf(v)); }

 private:
  std::vector<BlockIndex> blocks_;
  std::vector<BlockMask> masks_;
};

}  // namespace clearance
