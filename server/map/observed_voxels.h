// Which voxels of a SurfaceMap were observed, as bit masks: far cheaper to read than their values.
#pragma once

#include <array>
#include <cstdint>

#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// Of the 27 blocks around a block, itself at 13: index (dx + 1) * 9 + (dy + 1) * 3 + dz + 1.
struct ObservedVoxels {
  std::array<BlockMask, 27> any;  // with band weight or evidence
  BlockMask band;                 // with band weight, of the block itself
};
void ReadObserved(const SurfaceMap& map, const BlockIndex& block, ObservedVoxels* observed);

// Evidence of a block without halo.
void ReadOwnEvidence(const SurfaceMap& map, const BlockIndex& block,
                     int32_t evidence[kBlockVoxels]);

}  // namespace clearance
