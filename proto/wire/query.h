// Query requests as plain structs, all checks of the contract done that need no map.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "clearance/v1/query.pb.h"
#include "server/core/aabb.h"
#include "server/core/object_id.h"

namespace clearance::wire {

struct QueryLimits {
  size_t max_points = 100'000;
  size_t max_debug_points = 64;  // of positions_xyz
  double max_wait_s = 60;
};

// The asked time: absolute, or seconds after `reference_ns` (absent: after the map's stamp).
// Whether it lies inside the map's horizon is for whoever knows the map.
struct QueryTime {
  std::optional<int64_t> at_ns;
  double horizon_s = 0;
  std::optional<int64_t> reference_ns;
};

struct Layers {
  bool static_only = false;
  std::vector<ObjectId> only_objects;     // sorted, unique
  std::vector<ObjectId> without_objects;  // sorted, unique
};

struct Consistency {
  uint64_t min_revision = 0;
  uint64_t epoch = 0;   // 0: any
  uint64_t pin_id = 0;  // 0: the newest revision
  double wait_s = 0;
};

// What all queries share.
struct QuerySettings {
  std::string map;
  QueryTime time;
  bool weighted_fusion = false;
  Layers layers;
  double max_distance_m = 0;  // 0: the map's own
  double sigma_margin = 0;
  Consistency consistency;
};

struct PointsQuery {
  QuerySettings settings;
  Eigen::Matrix3Xd points_W;      // 3 x n, n >= 1
  std::vector<float> horizons_s;  // n, or empty
  bool gradients = false, objects = false, sigmas = false, unknown_distances = false;
};

struct ObjectsQuery {
  QuerySettings settings;  // fusion, layers and distances unused
  bool include_history = false;
};

struct SliceQuery {
  QuerySettings settings;
  double z_m = 0;
  std::optional<Aabb> bounds;  // x and y count
  double resolution_m = 0;     // 0: chosen by the server
  bool gradients = false;
};

// Errors: INVALID_ARGUMENT naming field, index, got and expected: an empty batch or too many
// points, more than one position field, lengths, values that are not finite, unknown enum values,
// layers that exclude one another, negative distances and waits.
absl::StatusOr<PointsQuery> PointsQueryFromProto(const v1::QueryPointsRequest& request,
                                                 const QueryLimits& limits = {});
absl::StatusOr<ObjectsQuery> ObjectsQueryFromProto(const v1::ListObjectsRequest& request,
                                                   const QueryLimits& limits = {});
absl::StatusOr<SliceQuery> SliceQueryFromProto(const v1::GetSliceRequest& request,
                                               const QueryLimits& limits = {});

absl::StatusOr<Layers> LayersFromProto(const v1::LayerSelection& layers, std::string_view field);
absl::StatusOr<Consistency> ConsistencyFromProto(const v1::Consistency& consistency,
                                                 const QueryLimits& limits, std::string_view field);

}  // namespace clearance::wire
