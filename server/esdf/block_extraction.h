// One block's sites and states, read from the surface map, and which neighbours that concerns.
#pragma once

#include <array>
#include <cstdint>

#include "server/esdf/site_extraction.h"
#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// What a block shows its neighbours' extraction, which looks one voxel beyond its own block.
struct BlockShadow {
  BlockMask observed{};    // voxels with free evidence or band weight
  BlockMask band{};        // voxels with band weight
  uint64_t band_hash = 0;  // of means and weights

  friend bool operator==(const BlockShadow&, const BlockShadow&) = default;
};

struct BlockExtraction {
  BlockSites sites;
  std::array<uint8_t, kBlockVoxels> states;  // attribute bits 0-3 of FieldVoxel
  BlockShadow shadow;
};

// Blocks without band cost a fraction of the others.
void ExtractBlock(const SurfaceMap& map, const BlockIndex& block, float min_weight,
                  BlockExtraction* out);

// Directions (as in SiteNeighbourhood: 27 bits, 13 never set) of the neighbours that must be
// extracted anew when a block's shadow changes like this.
uint32_t ConcernedNeighbours(const BlockShadow& before, const BlockShadow& after);

}  // namespace clearance
