#include "server/config/config_keys.h"

#include <Eigen/Core>
#include <cmath>

namespace clearance {
namespace {

using Read = std::function<std::string(const YAML::Node&, ServerConfig*)>;

template <typename Get>
Read Number(Get get) {
  return [get](const YAML::Node& node, ServerConfig* config) -> std::string {
    double value = 0;
    if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value)) {
      return "a number";
    }
    get(config) = value;
    return "";
  };
}

template <typename Get>
Read Count(Get get) {
  return [get](const YAML::Node& node, ServerConfig* config) -> std::string {
    int64_t value = 0;
    if (!node.IsScalar() || !YAML::convert<int64_t>::decode(node, value) || value < 0) {
      return "a whole number, not negative";
    }
    get(config) = static_cast<std::decay_t<decltype(get(config))>>(value);
    return "";
  };
}

template <typename Get>
Read Flag(Get get) {
  return [get](const YAML::Node& node, ServerConfig* config) -> std::string {
    bool value = false;
    if (!node.IsScalar() || !YAML::convert<bool>::decode(node, value)) return "true or false";
    get(config) = value;
    return "";
  };
}

template <typename Get>
Read Text(Get get) {
  return [get](const YAML::Node& node, ServerConfig* config) -> std::string {
    if (node.IsNull()) {
      get(config).clear();
      return "";
    }
    if (!node.IsScalar()) return "a text";
    get(config) = node.Scalar();
    return "";
  };
}

std::string ReadListen(const YAML::Node& node, ServerConfig* config) {
  config->listen.clear();
  if (node.IsNull()) return "";
  if (node.IsScalar()) {
    config->listen.push_back(node.Scalar());
    return "";
  }
  if (!node.IsSequence()) return "HOST:PORT or a list of them";
  for (const YAML::Node& address : node) {
    if (!address.IsScalar()) return "HOST:PORT or a list of them";
    config->listen.push_back(address.Scalar());
  }
  return "";
}

bool ReadPoint(const YAML::Node& node, Eigen::Vector3d* point) {
  if (!node.IsSequence() || node.size() != 3) return false;
  for (int i = 0; i < 3; ++i) {
    if (!node[i].IsScalar() || !YAML::convert<double>::decode(node[i], (*point)[i])) return false;
  }
  return point->allFinite();
}

std::string ReadBounds(const YAML::Node& node, ServerConfig* config) {
  if (node.IsNull()) {
    config->map.bounds.reset();
    return "";
  }
  Eigen::Vector3d lower, upper;
  if (!node.IsSequence() || node.size() != 2 || !ReadPoint(node[0], &lower) ||
      !ReadPoint(node[1], &upper)) {
    return "two corners [[x, y, z], [x, y, z]] in metres";
  }
  config->map.bounds = Aabb(lower, upper);
  return "";
}

std::string ReadOverload(const YAML::Node& node, ServerConfig* config) {
  const std::string value = node.IsScalar() ? node.Scalar() : "";
  if (value == "block") {
    config->map.overload = OverloadPolicy::kBlock;
  } else if (value == "drop_oldest_static") {
    config->map.overload = OverloadPolicy::kDropOldestStatic;
  } else {
    return "block or drop_oldest_static";
  }
  return "";
}

std::string ReadSync(const YAML::Node& node, ServerConfig* config) {
  const std::string value = node.IsScalar() ? node.Scalar() : "";
  if (value == "each") {
    config->store.fsync = SyncPolicy::kEach;
  } else if (value == "interval") {
    config->store.fsync = SyncPolicy::kInterval;
  } else if (value == "off") {
    config->store.fsync = SyncPolicy::kOff;
  } else {
    return "each, interval or off";
  }
  return "";
}

std::string ReadLogFormat(const YAML::Node& node, ServerConfig* config) {
  const std::string value = node.IsScalar() ? node.Scalar() : "";
  if (value == "text") {
    config->log_format = ServerConfig::LogFormat::kText;
  } else if (value == "json") {
    config->log_format = ServerConfig::LogFormat::kJson;
  } else {
    return "text or json";
  }
  return "";
}

std::string ReadLogCalls(const YAML::Node& node, ServerConfig* config) {
  const std::string value = node.IsScalar() ? node.Scalar() : "";
  if (value == "none") {
    config->log_calls = ServerConfig::LogCalls::kNone;
  } else if (value == "failed") {
    config->log_calls = ServerConfig::LogCalls::kFailed;
  } else if (value == "all") {
    config->log_calls = ServerConfig::LogCalls::kAll;
  } else {
    return "none, failed or all";
  }
  return "";
}

}  // namespace

// A key is its section and the name of the member that it sets.
#define CLEARANCE_KEY(kind, section, name)                                      \
  {                                                                             \
#section "." #name, kind([](ServerConfig * c) -> auto& { return c->name; }) \
  }
#define CLEARANCE_STORE_KEY(kind, name)                                           \
  {                                                                               \
    "store." #name, kind([](ServerConfig * c) -> auto& { return c->store.name; }) \
  }
#define CLEARANCE_MAP_KEY(kind, name)                                         \
  {                                                                           \
    "map." #name, kind([](ServerConfig * c) -> auto& { return c->map.name; }) \
  }

const std::vector<ConfigKey>& AllConfigKeys() {
  static const std::vector<ConfigKey>& keys = *new std::vector<ConfigKey>{
      {"server.listen", ReadListen},
      CLEARANCE_KEY(Text, server, socket),
      CLEARANCE_KEY(Text, server, http),
      CLEARANCE_KEY(Flag, server, allow_remote_plaintext),
      CLEARANCE_KEY(Count, server, worker_threads),
      CLEARANCE_KEY(Count, server, worker_queue),
      CLEARANCE_KEY(Number, server, drain_timeout_s),
      {"log.format", ReadLogFormat},
      {"log.calls", ReadLogCalls},
      {"security.certificate", Text([](ServerConfig * c) -> auto& { return c->tls_certificate; })},
      {"security.key", Text([](ServerConfig * c) -> auto& { return c->tls_key; })},
      {"security.client_ca", Text([](ServerConfig * c) -> auto& { return c->tls_client_ca; })},
      CLEARANCE_KEY(Text, security, access_file),
      CLEARANCE_KEY(Count, limits, max_message_bytes),
      CLEARANCE_KEY(Count, limits, max_maps),
      CLEARANCE_KEY(Count, limits, max_query_points),
      CLEARANCE_KEY(Count, limits, max_slice_cells),
      CLEARANCE_KEY(Count, limits, max_frame_points),
      CLEARANCE_KEY(Count, limits, max_image_pixels),
      CLEARANCE_KEY(Count, limits, max_motions),
      CLEARANCE_KEY(Number, limits, max_wait_s),
      CLEARANCE_KEY(Count, limits, max_region_cells),
      CLEARANCE_KEY(Count, limits, max_trajectories),
      CLEARANCE_KEY(Count, limits, max_waypoints),
      CLEARANCE_KEY(Count, limits, max_spheres),
      CLEARANCE_KEY(Count, limits, max_stream_requests),
      CLEARANCE_KEY(Count, limits, max_pins),
      CLEARANCE_KEY(Number, limits, pin_ttl_s),
      CLEARANCE_KEY(Number, limits, max_pin_ttl_s),
      CLEARANCE_KEY(Count, limits, memory_limit_bytes),
      CLEARANCE_KEY(Flag, limits, evict_over_memory),
      CLEARANCE_KEY(Count, limits, max_streams),
      CLEARANCE_STORE_KEY(Text, dir),
      {"store.fsync", ReadSync},
      CLEARANCE_STORE_KEY(Number, fsync_interval_s),
      CLEARANCE_STORE_KEY(Count, segment_bytes),
      CLEARANCE_STORE_KEY(Number, snapshot_period_s),
      CLEARANCE_STORE_KEY(Count, keep_snapshots),
      CLEARANCE_STORE_KEY(Flag, recover_damaged),
      CLEARANCE_KEY(Count, ingest, queue_frames),
      CLEARANCE_KEY(Count, ingest, credits),
      CLEARANCE_KEY(Count, ingest, live_credits),
      {"map.create_default", Flag([](ServerConfig * c) -> auto& { return c->create_default_map; })},
      CLEARANCE_MAP_KEY(Number, voxel_size_m),
      CLEARANCE_MAP_KEY(Number, max_distance_m),
      CLEARANCE_MAP_KEY(Number, truncation_m),
      CLEARANCE_MAP_KEY(Number, max_range_m),
      {"map.bounds", ReadBounds},
      {"map.overload_policy", ReadOverload},
      CLEARANCE_MAP_KEY(Number, object_lost_after_s),
      CLEARANCE_MAP_KEY(Number, object_retired_after_s),
      CLEARANCE_MAP_KEY(Number, max_horizon_s),
      CLEARANCE_MAP_KEY(Number, stale_after_s),
      {"map.memory_limit_bytes",
       Count([](ServerConfig * c) -> auto& { return c->map.memory_cap_bytes; })},
  };
  return keys;
}

#undef CLEARANCE_KEY
#undef CLEARANCE_STORE_KEY
#undef CLEARANCE_MAP_KEY

}  // namespace clearance
