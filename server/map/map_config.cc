#include "server/map/map_config.h"

#include <cmath>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

absl::Status InRange(const char* field, double got, double low, double high) {
  if (std::isfinite(got) && got >= low && got <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %g; must be %g to %g", field, got, low, high));
}

}  // namespace

absl::Status MapConfig::Validate() const {
  if (auto s = InRange("voxel_size_m", voxel_size_m, 0.01, 10); !s.ok()) return s;
  // The field stores offsets in 1/256 voxel in 16 bits.
  if (auto s = InRange("max_distance_m", max_distance_m, 2 * voxel_size_m, 120 * voxel_size_m);
      !s.ok()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s (2 to 120 voxels of %g m)", s.message(), voxel_size_m));
  }
  if (truncation_m != 0) {
    if (auto s = InRange("truncation_m", truncation_m, 1.5 * voxel_size_m, 4 * voxel_size_m);
        !s.ok()) {
      return s;
    }
  }
  // Voxel indices are 32 bit and poses may be far out; a single frame must not span the index
  // range.
  if (auto s = InRange("max_range_m", max_range_m, voxel_size_m, 1000); !s.ok()) return s;
  if (auto s = InRange("object_lost_after_s", object_lost_after_s, 0, 1e6); !s.ok()) return s;
  if (auto s = InRange("object_retired_after_s", object_retired_after_s, 10, 1e6); !s.ok())
    return s;
  if (object_retired_after_s < object_lost_after_s) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "object_retired_after_s is %g; must not be less than object_lost_after_s %g",
        object_retired_after_s, object_lost_after_s));
  }
  if (auto s = InRange("max_horizon_s", max_horizon_s, 0, 60); !s.ok()) return s;
  if (auto s = InRange("stale_after_s", stale_after_s, 0, 1e6); !s.ok()) return s;
  if (bounds) {
    if (!bounds->min().allFinite() || !bounds->max().allFinite() || bounds->isEmpty()) {
      return absl::InvalidArgumentError("bounds is empty or not finite; min must not exceed max");
    }
  }
  return absl::OkStatus();
}

}  // namespace clearance
