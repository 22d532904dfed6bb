// Alg. 1 of the paper: one frame in, one MapUpdate out.
#pragma once

#include "absl/status/statusor.h"
#include "server/core/frame.h"
#include "server/core/stage_laps.h"
#include "server/integration/free_space.h"
#include "server/integration/surface_band.h"
#include "server/map/map_update.h"
#include "server/map/world_map.h"

namespace clearance {

struct IntegratorOptions {
  BandOptions band;
  FreeSpaceOptions free_space;
  size_t min_object_points = 8;  // fewer points do not start a submap

  static IntegratorOptions For(const MapConfig& config);
};

class FrameIntegrator {
 public:
  explicit FrameIntegrator(const IntegratorOptions& options) : options_(options) {}

  // Pure: reads the map, changes nothing. INVALID_ARGUMENT for frames that ValidateFrame refuses;
  // motions that cannot be used become violations of the update. `laps` takes the time of the
  // stages: split, voxelise, band, free_space, objects, and per_object where there were any.
  absl::StatusOr<MapUpdate> Integrate(const Frame& frame, const WorldMap& map,
                                      StageLaps& laps) const;
  absl::StatusOr<MapUpdate> Integrate(const Frame& frame, const WorldMap& map) const;

 private:
  IntegratorOptions options_;
};

}  // namespace clearance
