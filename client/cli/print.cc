#include "client/cli/print.h"

#include <algorithm>
#include <iostream>

#include "absl/strings/str_format.h"
#include "client/sequence/text.h"

namespace clearance::cli {
namespace {

bool LooksLikeNumber(const std::string& cell) {
  double value = 0;
  return client::ParseNumber(cell, &value);
}

}  // namespace

std::string Table::Text() const {
  std::vector<size_t> widths(rows_[0].size(), 0);
  for (const auto& row : rows_) {
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const auto& row : rows_) {
    std::string line;
    for (size_t i = 0; i < row.size(); ++i) {
      const std::string padding(widths[i] - row[i].size(), ' ');
      line += i > 0 ? "  " : "";
      line += LooksLikeNumber(row[i]) ? padding + row[i] : row[i] + padding;
    }
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text;
}

std::string Number(double value, int decimals) { return absl::StrFormat("%.*f", decimals, value); }

std::string Bytes(uint64_t bytes) {
  if (bytes >= 10'000'000) return absl::StrFormat("%.1f MB", bytes * 1e-6);
  return absl::StrFormat("%.1f kB", bytes * 1e-3);
}

std::string_view StateName(uint8_t state_byte) {
  switch (client::StateOf(state_byte)) {
    case client::SpaceState::kFree:
      return "free";
    case client::SpaceState::kOccupied:
      return "occupied";
    case client::SpaceState::kUnknown:
      break;
  }
  return "unknown";
}

std::vector<std::string> FlagNames(uint8_t state_byte) {
  constexpr std::pair<uint8_t, const char*> kFlags[] = {
      {client::kFlagPredicted, "predicted"},
      {client::kFlagClamped, "clamped"},
      {client::kFlagNoGradient, "no_gradient"},
      {client::kFlagOutsideBounds, "outside_bounds"},
      {client::kFlagStale, "stale"},
      {client::kFlagLowConfidence, "low_confidence"}};
  std::vector<std::string> names;
  for (const auto& [flag, name] : kFlags) {
    if (state_byte & flag) names.emplace_back(name);
  }
  return names;
}

Json ToJson(const client::MapStamp& stamp) {
  return {{"revision", stamp.revision},
          {"field_revision", stamp.field_revision},
          {"epoch", stamp.epoch},
          {"stamp_ns", stamp.stamp_ns},
          {"staleness_s", stamp.staleness_s}};
}

Json ToJson(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

Json ToJson(const Pose& pose) {
  const Eigen::Quaterniond q(pose.linear());
  return {{"translation_m", ToJson(Eigen::Vector3d(pose.translation()))},
          {"quaternion_xyzw", Json::array({q.x(), q.y(), q.z(), q.w()})}};
}

Json ToJson(const client::ObjectBrief& brief) {
  return {{"object_id", brief.object_id},
          {"generation", brief.generation},
          {"class_name", brief.class_name},
          {"life_state", std::string(NameOf(brief.life))},
          {"world_from_object", ToJson(brief.T_W_L)},
          {"velocity_mps", ToJson(brief.twist.linear_mps)},
          {"angular_velocity_radps", ToJson(brief.twist.angular_radps)},
          {"speed_mps", brief.twist.linear_mps.norm()}};
}

Json ToJson(const std::vector<client::StampedPose>& path) {
  Json json = Json::array();
  for (const auto& pose : path) {
    Json entry = ToJson(pose.pose);
    entry["stamp_ns"] = pose.stamp_ns;
    json.push_back(std::move(entry));
  }
  return json;
}

Json ToJson(const client::ObjectInfo& info) {
  Json json = ToJson(info.brief);
  json["box"] = {{"world_from_box", ToJson(info.box.world_from_box)},
                 {"size_m", ToJson(info.box.size_m)}};
  json["first_seen_ns"] = info.first_seen_ns;
  json["last_seen_ns"] = info.last_seen_ns;
  json["observations"] = info.observations;
  if (!info.history.empty()) json["trajectory"] = ToJson(info.history);
  return json;
}

Json ToJson(const client::MapInfo& info) {
  Json json = {{"map", info.map}, {"stamp", ToJson(info.stamp)}};
  const auto put = [&](const char* name, const std::optional<double>& value) {
    if (value) json["config"][name] = *value;
  };
  put("voxel_size_m", info.settings.voxel_size_m);
  put("max_distance_m", info.settings.max_distance_m);
  put("truncation_m", info.settings.truncation_m);
  put("max_range_m", info.settings.max_range_m);
  put("max_horizon_s", info.settings.max_horizon_s);
  put("lost_after_s", info.settings.lost_after_s);
  put("retire_after_s", info.settings.retire_after_s);
  if (info.observed_bounds) {
    json["observed_bounds"] = {{"min", ToJson(Eigen::Vector3d(info.observed_bounds->min()))},
                               {"max", ToJson(Eigen::Vector3d(info.observed_bounds->max()))}};
  }
  json["memory_bytes"] = info.memory_bytes;
  json["static_voxels"] = info.static_voxels;
  json["live_objects"] = info.live_objects;
  json["known_objects"] = info.known_objects;
  json["sources"] = Json::array();
  for (const auto& source : info.sources) {
    Json entry = {{"source_id", source.source_id}};
    if (source.last_frame_id) entry["last_frame_id"] = *source.last_frame_id;
    entry["last_stamp_ns"] = source.last_stamp_ns;
    entry["frames_integrated"] = source.frames_integrated;
    entry["frames_dropped"] = source.frames_dropped;
    entry["frames_rejected"] = source.frames_rejected;
    json["sources"].push_back(std::move(entry));
  }
  if (!info.sensor_path.empty()) json["sensor_path"] = ToJson(info.sensor_path);
  return json;
}

void PrintJson(const Json& json) {
  // Names may come from outside: bytes that are not UTF-8 are replaced, not thrown at.
  std::cout << json.dump(2, ' ', false, Json::error_handler_t::replace) << "\n";
}

}  // namespace clearance::cli
