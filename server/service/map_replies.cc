#include "server/service/map_replies.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/map_config.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

constexpr double kMaxDistanceVoxels = 120;
constexpr size_t kMaxTrajectoryPoses = 40'000;  // 2.6 MB of a reply

void FillTrajectory(const MapView& view, v1::MapInfo* out) {
  if (!view.sensor_path) return;
  const std::vector<PoseStamp>& path = *view.sensor_path;
  const size_t first = path.size() - std::min(path.size(), kMaxTrajectoryPoses);
  std::vector<int64_t> stamps;
  for (size_t i = first; i < path.size(); ++i) {
    stamps.push_back(path[i].stamp_ns);
    wire::AppendPose(path[i].pose, out->mutable_trajectory_poses_f64());
  }
  out->set_trajectory_stamps_i64(wire::EncodeArray(stamps));
}

}  // namespace

absl::StatusOr<MapConfig> MapConfigFromProto(const v1::MapConfig& config,
                                             const MapConfig& defaults) {
  const absl::StatusOr<wire::MapSettings> settings = wire::MapSettingsFromProto(config);
  if (!settings.ok()) return settings.status();
  MapConfig result = defaults;
  result.voxel_size_m = settings->voxel_size_m.value_or(defaults.voxel_size_m);
  result.max_distance_m = settings->max_distance_m.value_or(
      std::min(defaults.max_distance_m, kMaxDistanceVoxels * result.voxel_size_m));
  // A default truncation belongs to the default voxel size.
  if (settings->voxel_size_m) result.truncation_m = 0;
  if (settings->truncation_m) result.truncation_m = *settings->truncation_m;
  result.max_range_m = settings->max_range_m.value_or(defaults.max_range_m);
  if (settings->bounds) result.bounds = settings->bounds;
  if (settings->drop_oldest_static) {
    result.overload =
        *settings->drop_oldest_static ? OverloadPolicy::kDropOldestStatic : OverloadPolicy::kBlock;
  }
  result.object_lost_after_s = settings->lost_after_s.value_or(defaults.object_lost_after_s);
  result.object_retired_after_s =
      settings->retire_after_s.value_or(defaults.object_retired_after_s);
  result.memory_cap_bytes = settings->memory_limit_bytes.value_or(defaults.memory_cap_bytes);
  result.max_horizon_s = settings->max_horizon_s.value_or(defaults.max_horizon_s);
  if (absl::Status s = result.Validate(); !s.ok()) {
    return absl::InvalidArgumentError(absl::StrFormat("config.%s", s.message()));
  }
  return result;
}

void ToProto(const MapConfig& config, v1::MapConfig* out) {
  out->set_voxel_size_m(config.voxel_size_m);
  out->set_max_distance_m(config.max_distance_m);
  out->set_truncation_m(config.truncation());
  out->set_max_range_m(config.max_range_m);
  if (config.bounds) wire::ToProto(*config.bounds, out->mutable_bounds());
  out->set_overload_policy(config.overload == OverloadPolicy::kBlock
                               ? v1::OVERLOAD_POLICY_BLOCK
                               : v1::OVERLOAD_POLICY_DROP_OLDEST_STATIC);
  out->mutable_object_times()->set_lost_after_s(config.object_lost_after_s);
  out->mutable_object_times()->set_retire_after_s(config.object_retired_after_s);
  out->set_memory_limit_bytes(config.memory_cap_bytes);
  out->set_max_horizon_s(config.max_horizon_s);
}

void FillMapInfo(const MappingEngine& engine, bool include_trajectory, v1::MapInfo* out) {
  const ViewPtr view = engine.Latest();
  const EngineStats stats = engine.Stats();
  out->set_map(engine.id());
  ToProto(engine.config(), out->mutable_config());
  ToProto(StampOf(*view), out->mutable_stamp());
  if (stats.sizes.observed_W)
    wire::ToProto(*stats.sizes.observed_W, out->mutable_observed_bounds());
  out->set_memory_bytes(stats.sizes.memory_bytes);
  out->set_static_voxels(stats.sizes.static_voxels);
  out->set_known_objects(view->objects.size());
  out->set_live_objects(std::count_if(
      view->objects.begin(), view->objects.end(),
      [](const ObjectView& object) { return object.life_state != LifeState::kRetired; }));
  for (const SourceStatus& source : stats.sources) {
    v1::SourceInfo* info = out->add_sources();
    info->set_source_id(source.source_id);
    if (source.last_frame_id) info->set_last_frame_id(*source.last_frame_id);
    info->set_last_stamp_ns(source.last_stamp_ns);
    info->set_frames_integrated(source.integrated);
    info->set_frames_dropped(source.dropped);
    info->set_frames_rejected(source.rejected);
  }
  if (include_trajectory) FillTrajectory(*view, out);
}

absl::StatusOr<RegionEdit> RegionEditFromProto(const v1::EditRegionRequest& request) {
  const absl::StatusOr<wire::EditRegion> region = wire::EditRegionFromProto(request);
  if (!region.ok()) return region.status();
  RegionEdit edit;
  edit.box = region->box;
  if (region->sphere) {
    edit.sphere_centre = region->sphere->center_W;
    edit.sphere_radius_m = region->sphere->radius_m;
  }
  switch (region->action) {
    case v1::EDIT_ACTION_MARK_FREE:
      edit.action = RegionAction::kMarkFree;
      break;
    case v1::EDIT_ACTION_MARK_OCCUPIED:
      edit.action = RegionAction::kMarkOccupied;
      break;
    default:
      edit.action = RegionAction::kClearToUnknown;
  }
  return edit;
}

}  // namespace clearance
