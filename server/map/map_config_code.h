// A map's configuration as bytes, exactly and in a versioned form: for snapshots and the data
// folder.
#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/map/map_config.h"

namespace clearance {

std::string EncodeMapConfig(const MapConfig& config);
// DATA_LOSS for bytes of another kind.
absl::StatusOr<MapConfig> DecodeMapConfig(std::string_view bytes);

}  // namespace clearance
