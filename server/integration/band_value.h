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

// Seen from one side only, what lies deeper than half a voxel behind a surface is a guess. Weight
// of such an observation, given what is stored in the voxel (weight 0: nothing): guesses do not
// pile up, so that a single look past the edge outweighs many of them, and hardly count where the
// voxel was seen from its outside. Other observations keep their weight.
float GuessedWeight(const BandValue& value, float stored_mean_m, float stored_weight,
                    float voxel_size_m);

}  // namespace clearance
