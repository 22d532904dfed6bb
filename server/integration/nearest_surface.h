// For every voxel of the band the surface voxel that decides it.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/integration/block_table.h"
#include "server/integration/local_voxels.h"

namespace clearance {

// Blocks within `reach_voxels` of any surface voxel, sorted, unique.
std::vector<BlockIndex> BandBlocksOf(const LocalVoxels& voxels, float reach_voxels);

// By voxel of `block`: the surface voxel whose centroid is nearest to the voxel's centre (the first
// of equally near ones), -1 where none is within `reach_voxels`, and the squared distance to it in
// voxels. Surface voxels with skip[i] do not count.
struct NearestVoxels {
  std::array<int32_t, kBlockVoxels> voxel;
  std::array<float, kBlockVoxels> squared_voxels;
};
NearestVoxels NearestSurface(const LocalVoxels& voxels, const BlockTable& table,
                             const std::vector<uint8_t>& skip, const BlockIndex& block,
                             float reach_voxels);

}  // namespace clearance
