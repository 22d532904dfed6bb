// What a voxel is: unknown, free or occupied, how sure that is, and on which side of the surface.
#pragma once

#include <array>
#include <cstdint>

#include "server/esdf/site_extraction.h"
#include "server/map/free_evidence.h"

namespace clearance {

// Attribute bits 0-3 of FieldVoxel.
inline constexpr uint16_t kStateBits = 3, kLowConfidenceBit = 4, kNegativeBit = 8;
inline constexpr uint16_t kVoxelBits = 15;                   // what belongs to the voxel
inline constexpr uint16_t kSiteBits = 0xffff & ~kVoxelBits;  // what belongs to its site

// Voxels of a block that were observed, and their 26 neighbours, too. `observed`: of the 27 blocks
// around it, as ReadObserved gives them.
BlockMask Surrounded(const std::array<BlockMask, 27>& observed);
// The same from halo copies (SurfaceMap::ReadBand and ReadEvidence).
BlockMask Surrounded(const float weight[kHaloVoxels], const int32_t evidence[kHaloVoxels]);

// FREE by evidence or UNKNOWN: what IsFree and IsConfidentlyFree say of every voxel of a block.
void ClassifyByEvidence(const int32_t evidence[kBlockVoxels], const BlockMask& surrounded,
                        uint8_t states[kBlockVoxels]);

// Attribute bits of the 512 voxels of a block, from its halo copies (SurfaceMap::ReadBand) and its
// sites; `states` comes with what ClassifyByEvidence says:
// - OCCUPIED where the cube contains the fused surface: weight >= min_weight and
//   |mean| <= h / 2 * |n|_1 (the cube's reach along the normal n), or a site;
// - else FREE by evidence, at high confidence where IsConfidentlyFree;
// - else, with weight >= min_weight: OCCUPIED where mean < 0, FREE at low confidence where mean >
// 0;
// - else UNKNOWN.
// OCCUPIED voxels carry the sign of their mean; FREE ones are outside; the sign of UNKNOWN ones
// follows their nearest site (field_updater). Low confidence is said of FREE voxels only.
void ClassifyBand(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                  const BlockSites& sites, float voxel_size_m, float min_weight,
                  uint8_t states[kBlockVoxels]);

// All of it from halo copies.
void ClassifyVoxels(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                    const int32_t evidence[kHaloVoxels], const BlockSites& sites,
                    float voxel_size_m, float min_weight, uint8_t states[kBlockVoxels]);

}  // namespace clearance
