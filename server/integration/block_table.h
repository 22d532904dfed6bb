// Which blocks of a frame's surface voxels lie around a block.
#pragma once

#include <array>
#include <cstdint>

#include "absl/container/flat_hash_map.h"
#include "server/integration/local_voxels.h"

namespace clearance {

class BlockTable {
 public:
  explicit BlockTable(const LocalVoxels& voxels) {
    ids_.reserve(voxels.blocks.size());
    for (size_t i = 0; i < voxels.blocks.size(); ++i) {
      ids_.emplace(voxels.blocks[i].block, static_cast<int32_t>(i));
    }
  }

  // Indices into LocalVoxels::blocks of the 3x3x3 blocks around `b` (x slowest), -1 where there is
  // no surface.
  std::array<int32_t, 27> Around(const BlockIndex& b) const {
    std::array<int32_t, 27> ids;
    int k = 0;
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dz = -1; dz <= 1; ++dz, ++k) {
          const auto it = ids_.find({b.x + dx, b.y + dy, b.z + dz});
          ids[k] = it == ids_.end() ? -1 : it->second;
        }
      }
    }
    return ids;
  }

 private:
  absl::flat_hash_map<BlockIndex, int32_t> ids_;
};

// Step, in blocks, from the middle to entry k of BlockTable::Around.
inline Eigen::Vector3i StepAround(int k) { return {k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1}; }

}  // namespace clearance
