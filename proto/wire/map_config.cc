#include "proto/wire/map_config.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "proto/wire/geometry.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {

absl::StatusOr<MapSettings> MapSettingsFromProto(const v1::MapConfig& config,
                                                 std::string_view field) {
  MapSettings settings;
  const v1::ObjectTimes& times = config.object_times();
  const struct {
    const char* name;
    double value;
    std::optional<double>* target;
  } numbers[] = {
      {"voxel_size_m", config.voxel_size_m(), &settings.voxel_size_m},
      {"max_distance_m", config.max_distance_m(), &settings.max_distance_m},
      {"truncation_m", config.truncation_m(), &settings.truncation_m},
      {"max_range_m", config.max_range_m(), &settings.max_range_m},
      {"object_times.lost_after_s", times.lost_after_s(), &settings.lost_after_s},
      {"object_times.retire_after_s", times.retire_after_s(), &settings.retire_after_s},
      {"object_times.evict_after_s", times.evict_after_s(), &settings.evict_after_s},
      {"max_horizon_s", config.max_horizon_s(), &settings.max_horizon_s},
  };
  for (const auto& number : numbers) {
    if (!std::isfinite(number.value) || number.value < 0) {
      return InvalidField(Path(field, number.name), -1, absl::StrCat(number.value),
                          "a finite number above 0, or 0 for the default");
    }
    if (number.value > 0) *number.target = number.value;
  }
  if (config.has_bounds()) {
    const auto bounds = BoxFromProto(config.bounds(), Path(field, "bounds"));
    if (!bounds.ok()) return bounds.status();
    settings.bounds = *bounds;
  }
  if (!v1::OverloadPolicy_IsValid(config.overload_policy())) {
    return InvalidField(Path(field, "overload_policy"), -1,
                        absl::StrCat(static_cast<int>(config.overload_policy())),
                        "OVERLOAD_POLICY_BLOCK or OVERLOAD_POLICY_DROP_OLDEST_STATIC");
  }
  if (config.overload_policy() != v1::OVERLOAD_POLICY_UNSPECIFIED) {
    settings.drop_oldest_static =
        config.overload_policy() == v1::OVERLOAD_POLICY_DROP_OLDEST_STATIC;
  }
  if (config.memory_limit_bytes() > 0) settings.memory_limit_bytes = config.memory_limit_bytes();
  return settings;
}

void ToProto(const MapSettings& settings, v1::MapConfig* out) {
  out->Clear();
  out->set_voxel_size_m(settings.voxel_size_m.value_or(0));
  out->set_max_distance_m(settings.max_distance_m.value_or(0));
  out->set_truncation_m(settings.truncation_m.value_or(0));
  out->set_max_range_m(settings.max_range_m.value_or(0));
  out->set_max_horizon_s(settings.max_horizon_s.value_or(0));
  out->set_memory_limit_bytes(settings.memory_limit_bytes.value_or(0));
  if (settings.bounds) ToProto(*settings.bounds, out->mutable_bounds());
  if (settings.drop_oldest_static) {
    out->set_overload_policy(*settings.drop_oldest_static ? v1::OVERLOAD_POLICY_DROP_OLDEST_STATIC
                                                          : v1::OVERLOAD_POLICY_BLOCK);
  }
  if (settings.lost_after_s || settings.retire_after_s || settings.evict_after_s) {
    v1::ObjectTimes* times = out->mutable_object_times();
    times->set_lost_after_s(settings.lost_after_s.value_or(0));
    times->set_retire_after_s(settings.retire_after_s.value_or(0));
    times->set_evict_after_s(settings.evict_after_s.value_or(0));
  }
}

absl::StatusOr<EditRegion> EditRegionFromProto(const v1::EditRegionRequest& request) {
  EditRegion edit;
  switch (request.region_case()) {
    case v1::EditRegionRequest::kBox: {
      const auto box = BoxFromProto(request.box(), "box");
      if (!box.ok()) return box.status();
      edit.box = *box;
      break;
    }
    case v1::EditRegionRequest::kSphere: {
      const auto center = PointFromProto(request.sphere().center(), "sphere.center");
      if (!center.ok()) return center.status();
      const double radius_m = request.sphere().radius_m();
      if (!std::isfinite(radius_m) || radius_m <= 0) {
        return InvalidField("sphere.radius_m", -1, absl::StrCat(radius_m), "above 0");
      }
      edit.sphere = EditRegion::Ball{*center, radius_m};
      break;
    }
    case v1::EditRegionRequest::REGION_NOT_SET:
      return InvalidField("region", -1, "nothing", "box or sphere");
  }
  if (!v1::EditAction_IsValid(request.action()) ||
      request.action() == v1::EDIT_ACTION_UNSPECIFIED) {
    return InvalidField("action", -1, absl::StrCat(static_cast<int>(request.action())),
                        "EDIT_ACTION_CLEAR_TO_UNKNOWN, _MARK_FREE or _MARK_OCCUPIED");
  }
  edit.action = request.action();
  return edit;
}

}  // namespace clearance::wire
