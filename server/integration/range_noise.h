// How noisy a depth image is, from the image itself.
#pragma once

#include "server/integration/range_image.h"

namespace clearance {

// Standard deviation of a pixel's measure, m: the robust spread of second differences along rows,
// of reciprocals, which vanish on planes. 0 for spherical images, whose returns lie too far apart
// to tell noise from shape.
double EstimateNoise(const RangeImage& image);

}  // namespace clearance
