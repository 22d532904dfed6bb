// Decision 9: static that starts to move. An object's points release the static surface they lie
// on.
#pragma once

#include <vector>

#include "server/integration/local_voxels.h"
#include "server/integration/static_returns.h"
#include "server/map/map_update.h"
#include "server/map/surface_map.h"

namespace clearance {

// Static surface within a voxel of the object's points of this frame (object_W, voxels in W),
// unless static returns of this frame lie as near: a wheel does not release the road it
// stands on. Sorted by block.
std::vector<ReleasedBlock> ReleaseClaimed(const LocalVoxels& object_W, const StaticReturns& returns,
                                          const SurfaceMap& static_map);

}  // namespace clearance
