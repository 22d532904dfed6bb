// Labels end a few pixels before the object does: returns beside an object's outline, and at its
// distance, are neither surely static nor surely the object's.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/integration/range_image.h"

namespace clearance {

struct RimOptions {
  int pixels = 4;         // of a depth image
  double rim_rad = 0.03;  // of a cloud: its labels come from boxes or images with wider errors
  double reach_m = 1.0;   // farther from the object's return, a neighbour is something else
};

// The label of rim pixels: no map's, so that no gap is bridged from them either.
inline constexpr uint16_t kRimLabel = 0xffff;

// `static_points` (columns of points_X, in X, both as SplitByLabel gives them) without those in the
// rim of an object: left out of the static map, they cannot leave a trail of the object there.
// Their rays still are evidence for free space; what is static is seen again when the object has
// moved on. Order is kept.
// Their pixels in `image` get kRimLabel.
std::vector<uint32_t> WithoutLabelRims(RangeImage& image, const Eigen::Matrix3Xf& points_X,
                                       std::vector<uint32_t> static_points,
                                       const RimOptions& options = {});

}  // namespace clearance
