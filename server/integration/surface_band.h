// Sec. III-B: local Gaussian-process distance fields evaluated at the voxel centres of the band.
#pragma once

#include "server/core/object_id.h"
#include "server/core/pose.h"
#include "server/field/gp_options.h"
#include "server/integration/local_voxels.h"
#include "server/integration/range_image.h"
#include "server/map/map_update.h"
#include "server/map/surface_map.h"

namespace clearance {

struct BandOptions {
  GpOptions gp;
  double truncation_m = 0.2;  // half width of the band
};

// d_k and 1 - v_k for the voxels around this frame's surface. Sign from the range image, seen along
// the view ray: a voxel in front of what was measured is outside; behind it, inside, but only where
// the measured pixel belongs to `id`. Pure; `existing` is what is stored: it limits what guesses
// behind surfaces add, and where it agrees with the frame and was seen often enough, it is only
// confirmed (weight 0).
BandObservations ObserveBand(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X,
                             ObjectId id, const SurfaceMap& existing, const BandOptions& options);

}  // namespace clearance
