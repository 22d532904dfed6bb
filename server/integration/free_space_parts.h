// The two ways to observe free space; ObserveFreeSpace chooses. Private to integration.
#pragma once

#include <vector>

#include "server/integration/free_space.h"
#include "server/integration/static_returns.h"

namespace clearance {

// Dense images: whole blocks against a pyramid of the image, voxel by voxel at block borders.
std::vector<FreeBlock> ObserveFreeSpacePinhole(const RangeImage& image, const Pose& T_W_X,
                                               const StaticReturns& returns,
                                               const SurfaceMap& static_map,
                                               const FreeSpaceOptions& options);

// Sparse rays: every ray is walked, voxel by voxel, to just before its return.
std::vector<FreeBlock> ObserveFreeSpaceRays(const RangeImage& image, const Pose& T_W_X,
                                            const StaticReturns& returns,
                                            const SurfaceMap& static_map,
                                            const FreeSpaceOptions& options);

}  // namespace clearance
