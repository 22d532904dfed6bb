// The state of every voxel of a box of the static map, exactly as the distance field composes it.
#pragma once

#include "server/map/surface_map.h"
#include "tests/evaluation/voxel_box.h"

namespace clearance::evaluation {

enum class Known : uint8_t { kUnknown, kFree, kOccupied };
struct StateOfVoxel {
  Known known = Known::kUnknown;
  bool confident = false;
};

void ComposeStates(const SurfaceMap& map, const FusionOptions& fusion, VoxelBox<StateOfVoxel>& box);

}  // namespace clearance::evaluation
