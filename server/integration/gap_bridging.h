// Surface seen at a grazing angle: neighbouring rays land several voxels apart on one plane.
#pragma once

#include <Eigen/Core>

#include "server/core/object_id.h"
#include "server/core/pose.h"
#include "server/integration/local_voxels.h"
#include "server/integration/range_image.h"

namespace clearance {

struct BridgeOptions {
  double widest_gap_voxels = 6.0;  // wider gaps stay unknown
  double deviation_voxels = 0.25;  // of the far return from the line through the two before it
  // Between neighbouring pixels of one object in a depth image gaps are bridged without that line:
  // a car's roof is often seen by a single row of pixels. What lies between could only be a hollow
  // that no ray looked into.
  double widest_object_gap_voxels = 12.0;
  double widest_object_gap_m = 1.2;
  double noise_m = 0;  // of the measure; gaps must be well above it
};

// Points (3 x n, in X, half a voxel apart) on the lines between neighbouring returns of map `id`
// that lie more than a voxel apart, where the line through the last two returns before the gap, in
// the same row or column of the image, meets the one behind it: ground between a lidar's rings,
// roofs seen edge-on. At depth edges it misses. Deterministic.
Eigen::Matrix3Xf BridgeGaps(const RangeImage& image, ObjectId id, double voxel_size_m,
                            const BridgeOptions& options = {});

// The voxels of map `id`, and those that only bridges pass through (one point each).
LocalVoxels WithBridges(const LocalVoxels& voxels, const RangeImage& image, const Pose& T_M_X,
                        ObjectId id, double noise_m);

}  // namespace clearance
