// For every voxel of the band the surface voxel that decides it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/integration/block_table.h"
#include "server/integration/local_voxels.h"

namespace clearance {

// Blocks within `reach_voxels` of any surface voxel, sorted, unique.
// `of`: the surface voxels that count, by block of `voxels`.
std::vector<BlockIndex> BandBlocksOf(const LocalVoxels& voxels, const std::vector<BlockMask>& of,
                                     float reach_voxels);

// By voxel of `block`: the surface voxel whose centroid is nearest to the voxel's centre (the first
// of equally near ones), -1 where none is within `reach_voxels`. Surface voxels with skip[i] do not
// count. Only rows along z (bits x * 8 + y of `rows`) are filled in; -1 in the others.
std::array<int32_t, kBlockVoxels> NearestSurface(const LocalVoxels& voxels, const BlockTable& table,
                                                 const std::vector<uint8_t>& skip,
                                                 const BlockIndex& block, float reach_voxels,
                                                 uint64_t rows = ~uint64_t{0});

// Rows of `block` along z that may lie within reach of the surface voxels in `of` (by block of
// `voxels`), as above.
uint64_t RowsWithin(const BlockTable& table, const std::vector<BlockMask>& of,
                    const BlockIndex& block, float reach_voxels);

}  // namespace clearance
