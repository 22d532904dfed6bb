// Sub-voxel surface sites from the fused zero crossing of a map's running mean.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "server/map/distance_field.h"
#include "server/map/map_update.h"
#include "server/map/object_shape.h"
#include "server/map/surface_map.h"

namespace clearance {

// The sites of one block. A voxel holds at most one site, and holds it inside its own cube, so that
// the site's voxel follows from its position.
struct BlockSites {
  BlockMask mask{};  // voxels that hold a site
  // Where the mask says so: dx, dy, dz from the voxel's centre to its site, each in [-128, 127],
  // and the site's attributes (sigma, normal). Elsewhere undefined.
  std::array<FieldVoxel, kBlockVoxels> site;
};

// A neighbour belongs to the same surface only if the mean changes less than this, in voxels a
// voxel: a distance cannot change by more than one, and silhouettes jump from front to behind.
inline constexpr float kMaxJumpVoxels = 1.5f;

// Gradient of the mean at halo offset `h` (inside 0..7), in metres a metre: central differences
// over voxels with weight >= min_weight and without a jump, one-sided at borders, 0 along axes
// without a usable neighbour.
Eigen::Vector3f MeanGradient(const float* mean, const float* weight, int h, float voxel_size_m,
                             float min_weight);

// Sites of a block from its halo copies (SurfaceMap::ReadBand). The foot of the voxel's centre on
// the surface, s = c - mean * n, kept when it lies in the voxel's own cube. Because it needs no
// change of sign, it also finds what is thinner than a voxel; edge crossings lose an 8 cm pole on a
// 10 cm grid altogether (tests/evaluation/field_accuracy prints both).
void ExtractSites(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                  float voxel_size_m, float min_weight, BlockSites* sites);

// Every site of a map with its normal, blocks in sorted order, offsets rising: an object's surface.
// p in the map's frame, float metres: meant for object frames, whose surface is near their origin.
std::vector<SurfaceSite> ExtractSurfaceSites(const SurfaceMap& map, const FusionOptions& options);

}  // namespace clearance
