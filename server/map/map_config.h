// What a map is made with. Immutable for the map's life.
#pragma once

#include <cstdint>
#include <optional>

#include "absl/status/status.h"
#include "server/core/aabb.h"

namespace clearance {

enum class OverloadPolicy { kBlock, kDropOldestStatic };

struct MapConfig {
  double voxel_size_m = 0.1;
  double max_distance_m = 5.0;  // distances are clamped here; at most 120 voxels
  double truncation_m = 0.0;    // half width of the fused surface band; 0 = 2 voxels
  double max_range_m = 25.0;    // farther returns are not integrated
  std::optional<Aabb> bounds;   // W; nothing outside is mapped or answered
  OverloadPolicy overload = OverloadPolicy::kBlock;
  double object_lost_after_s = 2.0;      // COASTING -> LOST, on frame stamps
  double object_retired_after_s = 10.0;  // LOST -> RETIRED, at least 10 s unseen
  double max_horizon_s = 5.0;
  double stale_after_s = 1.0;
  uint64_t memory_cap_bytes = 0;  // 0 = none

  double truncation() const { return truncation_m > 0 ? truncation_m : 2.0 * voxel_size_m; }

  // INVALID_ARGUMENT naming the field, what it is and what it may be.
  absl::Status Validate() const;
};

}  // namespace clearance
