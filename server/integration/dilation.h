// Sets of voxels grown by one voxel in every direction.
#pragma once

#include <array>
#include <cstdint>

#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// The voxels of a block that are in a set or have one of it among their 26 neighbours. `around`:
// the set in the 3x3x3 blocks around (x slowest, the block itself at 13), null where it has none.
inline BlockMask Dilated(const std::array<const BlockMask*, 27>& around) {
  const auto first = [](int b) { return b < 0 ? -1 : b * kBlockSide; };
  const auto last = [](int b) { return b < 0 ? -1 : b > 0 ? kBlockSide : kBlockSide - 1; };
  // Rows of ten bits along z, with a halo of one voxel all around.
  std::array<std::array<uint32_t, kHaloSide>, kHaloSide> rows{};
  for (int k = 0; k < 27; ++k) {
    if (!around[k]) continue;
    const int bx = k / 9 - 1, by = k / 3 % 3 - 1, bz = k % 3 - 1;
    for (int x = first(bx); x <= last(bx); ++x) {
      for (int y = first(by); y <= last(by); ++y) {
        const uint32_t row = ((*around[k])[x & 7] >> (8 * (y & 7))) & 0xff;
        rows[x + 1][y + 1] |= bz < 0 ? row >> 7 : bz > 0 ? (row & 1) << 9 : row << 1;
      }
    }
  }
  BlockMask grown{};
  for (int x = 0; x < kBlockSide; ++x) {
    for (int y = 0; y < kBlockSide; ++y) {
      uint32_t any = 0;
      for (int dx = 0; dx < 3; ++dx) {
        any |= rows[x + dx][y] | rows[x + dx][y + 1] | rows[x + dx][y + 2];
      }
      grown[x] |= static_cast<uint64_t>((any | any >> 1 | any >> 2) & 0xff) << (8 * y);
    }
  }
  return grown;
}

}  // namespace clearance
