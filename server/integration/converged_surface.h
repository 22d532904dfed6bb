// Surface of a frame that the map knows already: most of a frame shows again what was seen before.
#pragma once

#include <array>
#include <vector>

#include "server/integration/local_voxels.h"
#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// Of one block of the frame's surface voxels.
struct KnownSurface {
  // Voxels that need not be evaluated again: stored often enough, flat, with the band before and
  // behind, and with the centroid on the stored surface.
  BlockMask converged{};
  // Stored voxels that those confirm: themselves and their face neighbours, where these hold the
  // same plane at most half a cube's diagonal away. By block: the six face neighbours (-x, +x, -y,
  // +y, -z, +z), each in its own coordinates, then the block itself.
  static constexpr int kOwn = 6;
  std::array<BlockMask, 7> confirmed{};
};

// By block of `voxels`. noise_m: standard deviation of one point along its ray; noise takes more
// looks.
std::vector<KnownSurface> FindKnownSurface(const LocalVoxels& voxels, const SurfaceMap& existing,
                                           double noise_m);

}  // namespace clearance
