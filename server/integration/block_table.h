// Which blocks of a frame's surface voxels lie around a block.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "server/integration/local_voxels.h"

namespace clearance {

class BlockTable {
 public:
  explicit BlockTable(const LocalVoxels& voxels) {
    if (voxels.blocks.empty()) return;
    BlockIndex high = low_ = voxels.blocks[0].block;
    for (const LocalVoxels::Block& b : voxels.blocks) {
      low_ = {std::min(low_.x, b.block.x), std::min(low_.y, b.block.y),
              std::min(low_.z, b.block.z)};
      high = {std::max(high.x, b.block.x), std::max(high.y, b.block.y),
              std::max(high.z, b.block.z)};
    }
    // A rim of two: neighbours of neighbours are asked about.
    low_ = {low_.x - 2, low_.y - 2, low_.z - 2};
    side_ = {int64_t{high.x} - low_.x + 3, int64_t{high.y} - low_.y + 3,
             int64_t{high.z} - low_.z + 3};
    if (side_[0] <= kLargest && side_[1] <= kLargest && side_[2] <= kLargest &&
        side_[0] * side_[1] * side_[2] <= kLargest) {
      dense_.assign(static_cast<size_t>(side_[0] * side_[1] * side_[2]), -1);
      for (size_t i = 0; i < voxels.blocks.size(); ++i) {
        dense_[At(voxels.blocks[i].block)] = static_cast<int32_t>(i);
      }
      return;
    }
    sparse_.reserve(voxels.blocks.size());
    for (size_t i = 0; i < voxels.blocks.size(); ++i) {
      sparse_.emplace(voxels.blocks[i].block, static_cast<int32_t>(i));
    }
  }

  // Indices into LocalVoxels::blocks of the 3x3x3 blocks around `b` (x slowest), -1 where there is
  // no surface.
  std::array<int32_t, 27> Around(const BlockIndex& b) const {
    std::array<int32_t, 27> ids;
    ids.fill(-1);
    if (!dense_.empty()) {
      if (b.x <= low_.x || b.y <= low_.y || b.z <= low_.z || b.x - low_.x >= side_[0] - 1 ||
          b.y - low_.y >= side_[1] - 1 || b.z - low_.z >= side_[2] - 1) {
        return ids;
      }
      int k = 0;
      for (int dx = -1; dx <= 1; ++dx) {
        for (int dy = -1; dy <= 1; ++dy, k += 3) {
          std::memcpy(&ids[k], &dense_[At({b.x + dx, b.y + dy, b.z - 1})], 3 * sizeof(int32_t));
        }
      }
      return ids;
    }
    int k = 0;
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz, ++k) {
          const auto it = sparse_.find({b.x + dx, b.y + dy, b.z + dz});
          if (it != sparse_.end()) ids[k] = it->second;
        }
      }
    }
    return ids;
  }

 private:
  // Blocks of a box about the frame are numbered one by one, unless a stray return makes it vast.
  static constexpr int64_t kLargest = int64_t{1} << 21;

  size_t At(const BlockIndex& b) const {
    return static_cast<size_t>(((b.x - low_.x) * side_[1] + (b.y - low_.y)) * side_[2] +
                               (b.z - low_.z));
  }

  BlockIndex low_{0, 0, 0};
  std::array<int64_t, 3> side_{};
  std::vector<int32_t> dense_;
  absl::flat_hash_map<BlockIndex, int32_t> sparse_;
};

// Step, in blocks, from the middle to entry k of BlockTable::Around.
inline Eigen::Vector3i StepAround(int k) { return {k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1}; }

// By direction (as in BlockTable::Around): the voxels of the block there that lie within `reach`
// (1 to 8) of the block in the middle, of which it is the neighbour.
const std::array<BlockMask, 27>& RimMasks(int reach);

}  // namespace clearance
