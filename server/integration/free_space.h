// Free evidence of one frame for the static map, and contradiction of surface that is no longer
// there.
#pragma once

#include <vector>

#include "server/core/pose.h"
#include "server/integration/local_voxels.h"
#include "server/integration/range_image.h"
#include "server/map/map_update.h"
#include "server/map/surface_map.h"

namespace clearance {

struct FreeSpaceOptions {
  double voxel_size_m = 0.1;
  double max_range_m = 25.0;
};

// All rays count, those that end on objects too (paper Alg. 1: free voxels of object clouds go to
// R^0; only evidence, never the object's distances). No return is no evidence. A cube with a static
// return of this frame (`static_voxels`, in W) is neither free nor contradicted. Sorted by block.
std::vector<FreeBlock> ObserveFreeSpace(const RangeImage& image, const Pose& T_W_X,
                                        const LocalVoxels& static_voxels,
                                        const SurfaceMap& static_map,
                                        const FreeSpaceOptions& options);

}  // namespace clearance
