// MapConfig as a plain struct; what is absent is the server's default.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "absl/status/statusor.h"
#include "clearance/v1/map.pb.h"
#include "server/core/aabb.h"

namespace clearance::wire {

struct MapSettings {
  std::optional<double> voxel_size_m;
  std::optional<double> max_distance_m;
  std::optional<double> truncation_m;
  std::optional<double> max_range_m;
  std::optional<Aabb> bounds;
  std::optional<bool> drop_oldest_static;  // false: block
  std::optional<double> lost_after_s, retire_after_s, evict_after_s;
  std::optional<uint64_t> memory_limit_bytes;
  std::optional<double> max_horizon_s;
};

// Errors: INVALID_ARGUMENT naming the field below `field`: values that are not finite or negative,
// a bad box, an unknown policy. Limits that relate fields to one another are the map's to check.
absl::StatusOr<MapSettings> MapSettingsFromProto(const v1::MapConfig& config,
                                                 std::string_view field = "config");
void ToProto(const MapSettings& settings, v1::MapConfig* out);

// A region to edit: exactly one of the two.
struct EditRegion {
  std::optional<Aabb> box;
  struct Ball {
    Eigen::Vector3d center_W;
    double radius_m;
  };
  std::optional<Ball> sphere;
  v1::EditAction action = v1::EDIT_ACTION_UNSPECIFIED;  // never unspecified once checked
};
absl::StatusOr<EditRegion> EditRegionFromProto(const v1::EditRegionRequest& request);

}  // namespace clearance::wire
