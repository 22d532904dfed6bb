// What a caller asks of the distance field and what comes back, as plain arrays.
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "server/core/object_id.h"

namespace clearance {

enum class Fusion {
  kMin,       // the smallest distance of all maps: conservative, the default
  kWeighted,  // paper Sec. III-E: mean weighted by confidence; near and far surfaces blur
};

// Which surfaces count. All of them when everything is empty.
struct LayerSelection {
  bool static_only = false;                 // excludes the two lists
  std::vector<ObjectId> only_objects{};     // these objects without the static map
  std::vector<ObjectId> without_objects{};  // everything but these objects
};

// The state byte: low two bits the VoxelState, then flags.
namespace state_byte {
inline constexpr uint8_t kStateMask = 0x03;
inline constexpr uint8_t kPredicted = 0x04;      // an object carried ahead in time decides
inline constexpr uint8_t kClamped = 0x08;        // nothing nearer than the maximum distance
inline constexpr uint8_t kNoGradient = 0x10;     // the gradient is zero
inline constexpr uint8_t kOutsideBounds = 0x20;  // outside the map's bounds: state UNKNOWN
inline constexpr uint8_t kStale = 0x40;          // published longer ago than stale_after_s
inline constexpr uint8_t kLowConfidence = 0x80;
}  // namespace state_byte

struct QueryOptions {
  double horizon_s = 0;             // of all points, seconds after the view's stamp, >= 0
  std::vector<float> horizons_s{};  // one a point; replaces horizon_s when not empty
  bool gradients = false;
  bool objects = false;  // object_ids and object_indices
  bool sigmas = false;
  bool unknown_distances = false;
  Fusion fusion = Fusion::kMin;
  LayerSelection layers{};
  double max_distance_m = 0;  // answers are clamped here; 0, or more than the map's = the map's
  double sigma_margin = 0;    // distances are reduced by this many sigmas
  bool parallel = true;       // large batches may use several threads; the bytes do not change
  // When the answer is given, for the stale flag; absent = no flag.
  std::optional<std::chrono::steady_clock::time_point> now{};
};

// One entry a point, in the order of the points. Arrays that were not asked for are empty.
struct DistanceBatch {
  std::vector<float> distances_m;    // > 0 outside, < 0 inside; finite, within +-max_distance_m
  std::vector<uint8_t> states;       // state_byte
  Eigen::Matrix3Xf gradients_W;      // unit gradient of the signed distance, zero with kNoGradient
  std::vector<uint32_t> object_ids;  // the object whose surface is nearest, 0 = static or none
  std::vector<float> sigmas_m;       // standard deviation of the distance
  std::vector<float> unknown_distances_m;  // to the nearest unknown voxel, 0 inside one; clamped
  std::vector<uint32_t> object_indices;    // in view.objects, of all ids named above, ascending
};

}  // namespace clearance
