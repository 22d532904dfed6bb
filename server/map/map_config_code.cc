#include "server/map/map_config_code.h"

#include "server/core/bytes.h"

namespace clearance {
namespace {
constexpr uint32_t kVersion = 1;
}

std::string EncodeMapConfig(const MapConfig& config) {
  ByteWriter out;
  out.Put(kVersion);
  for (double value : {config.voxel_size_m, config.max_distance_m, config.truncation_m,
                       config.max_range_m, config.object_lost_after_s,
                       config.object_retired_after_s, config.max_horizon_s, config.stale_after_s}) {
    out.Put(value);
  }
  out.Put<uint8_t>(config.bounds.has_value());
  const Aabb bounds = config.bounds.value_or(Aabb(Eigen::Vector3d(0, 0, 0)));
  out.PutMatrix(bounds.min());
  out.PutMatrix(bounds.max());
  out.Put<uint8_t>(config.overload == OverloadPolicy::kDropOldestStatic);
  out.Put(config.memory_cap_bytes);
  return out.Take();
}

absl::StatusOr<MapConfig> DecodeMapConfig(std::string_view bytes) {
  ByteReader in(bytes, "map configuration");
  if (in.Get<uint32_t>() != kVersion) return in.Error("of an unknown version");
  MapConfig config;
  for (double* value :
       {&config.voxel_size_m, &config.max_distance_m, &config.truncation_m, &config.max_range_m,
        &config.object_lost_after_s, &config.object_retired_after_s, &config.max_horizon_s,
        &config.stale_after_s}) {
    *value = in.Get<double>();
  }
  const bool bounded = in.Get<uint8_t>() != 0;
  Eigen::Vector3d low, high;
  in.GetMatrix(low);
  in.GetMatrix(high);
  if (bounded) config.bounds = Aabb(low, high);
  config.overload =
      in.Get<uint8_t>() != 0 ? OverloadPolicy::kDropOldestStatic : OverloadPolicy::kBlock;
  config.memory_cap_bytes = in.Get<uint64_t>();
  if (absl::Status s = in.Finish(); !s.ok()) return s;
  if (absl::Status s = config.Validate(); !s.ok()) return in.Error(std::string(s.message()));
  return config;
}

}  // namespace clearance
