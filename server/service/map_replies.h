// Maps and their configurations as messages.
#pragma once

#include "absl/status/statusor.h"
#include "clearance/v1/map.pb.h"
#include "server/engine/mapping_engine.h"
#include "server/map/map_config.h"
#include "server/map/world_map.h"

namespace clearance {

// Fills what `config` leaves open from `defaults`. A default max_distance_m gives way where a finer
// voxel size makes it too far. INVALID_ARGUMENT as MapSettingsFromProto and MapConfig::Validate.
absl::StatusOr<MapConfig> MapConfigFromProto(const v1::MapConfig& config,
                                             const MapConfig& defaults);
void ToProto(const MapConfig& config, v1::MapConfig* out);

void FillMapInfo(const MappingEngine& engine, bool include_trajectory, v1::MapInfo* out);

absl::StatusOr<RegionEdit> RegionEditFromProto(const v1::EditRegionRequest& request);

}  // namespace clearance
