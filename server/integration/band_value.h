// From an unsigned distance and a line of sight to a signed observation.
#pragma once

#include <cstdint>
#include <optional>

#include "server/integration/sight.h"

namespace clearance {

struct BandValue {
  float distance_m = 0;  // > 0 outside
  float weight = 0;
};

// along_normal_m: component of (point - foot) along the surface normal towards the sensor;
// distance_m its length. cos_view: |normal . ray|. variance: latent v. `id`: the map's label.
// Absent where nothing can be said: hidden behind another map's surface, deep behind this one, or
// without a line of sight and not near the local plane.
std::optional<BandValue> DecideBandValue(const Sight& sight, float along_normal_m, float distance_m,
                                         float cos_view, float variance, uint16_t id,
                                         float voxel_size_m);

}  // namespace clearance
