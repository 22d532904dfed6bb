// How sites enter the closest-site field.
#pragma once

#include <array>
#include <cstdint>

#include "server/esdf/site_table.h"
#include "server/map/distance_field.h"

namespace clearance {

// The 27 blocks around a block, itself at 13: index (dx + 1) * 9 + (dy + 1) * 3 + dz + 1.
using SiteNeighbourhood = std::array<const SiteBlock*, 27>;

// Voxels of a block that touch the neighbour in direction `d` of a SiteNeighbourhood.
const BlockMask& BorderMask(int d);

// Offers the sites to the voxels of `block` within one voxel (3^3 around each site's own voxel): a
// site may be the nearest to voxels around it and not to its own voxel's centre, and would then
// never be passed on. `only_fresh` leaves out the sites that were there before.
void SeedBlock(const SiteNeighbourhood& sites, bool only_fresh, int32_t squared_limit,
               FieldBlock* block);

}  // namespace clearance
