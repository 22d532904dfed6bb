// Which blocks of two fields differ.
#pragma once

#include <memory>
#include <vector>

#include "server/map/distance_field.h"

namespace clearance {

struct FieldDifference {
  BlockIndex index;
  std::shared_ptr<const FieldBlock> before, after;
  uint8_t tile_before = DistanceField::kNoTile, tile_after = DistanceField::kNoTile;
};

// Every block that is not the same pointer or the same tile in both, in sorted order; nullptr and
// kNoTile where a field has nothing. Fields that were copied from one another share what neither
// changed: no voxel is compared.
std::vector<FieldDifference> DifferencesBetween(const DistanceField& before,
                                                const DistanceField& after);

}  // namespace clearance
