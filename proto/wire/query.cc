#include "proto/wire/query.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/wire/array.h"
#include "proto/wire/check.h"
#include "proto/wire/geometry.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

absl::Status CheckNotNegative(double value, std::string_view field) {
  if (std::isfinite(value) && value >= 0) return absl::OkStatus();
  return InvalidField(field, -1, absl::StrCat(value), "a finite number, 0 or more");
}

absl::Status CheckFiniteValue(double value, std::string_view field) {
  if (std::isfinite(value)) return absl::OkStatus();
  return InvalidField(field, -1, absl::StrCat(value), "a finite number");
}

// The fields that requests share by name.
template <typename Request>
absl::Status TimeFromProto(const Request& request, QueryTime& time) {
  if (request.time_case() == Request::kAtNs) time.at_ns = request.at_ns();
  if (request.time_case() == Request::kHorizonS) {
    if (absl::Status s = CheckFiniteValue(request.horizon_s(), "horizon_s"); !s.ok()) return s;
    time.horizon_s = request.horizon_s();
  }
  if (request.reference_ns() != 0) time.reference_ns = request.reference_ns();
  return absl::OkStatus();
}

template <typename Request>
absl::Status AddressFromProto(const Request& request, const QueryLimits& limits,
                              QuerySettings& settings) {
  auto map = NameFromProto(request.map(), "map");
  if (!map.ok()) return map.status();
  settings.map = *std::move(map);
  if (absl::Status s = TimeFromProto(request, settings.time); !s.ok()) return s;
  const auto consistency = ConsistencyFromProto(request.consistency(), limits, "consistency");
  if (!consistency.ok()) return consistency.status();
  settings.consistency = *consistency;
  return absl::OkStatus();
}

template <typename Request>
absl::Status DistanceSettingsFromProto(const Request& request, QuerySettings& settings) {
  if (!v1::Fusion_IsValid(request.fusion())) {
    return InvalidField("fusion", -1, absl::StrCat(static_cast<int>(request.fusion())),
                        "FUSION_MIN or FUSION_WEIGHTED");
  }
  settings.weighted_fusion = request.fusion() == v1::FUSION_WEIGHTED;
  auto layers = LayersFromProto(request.layers(), "layers");
  if (!layers.ok()) return layers.status();
  settings.layers = *std::move(layers);
  if (absl::Status s = CheckNotNegative(request.max_distance_m(), "max_distance_m"); !s.ok()) {
    return s;
  }
  settings.max_distance_m = request.max_distance_m();
  if constexpr (requires { request.sigma_margin(); }) {
    absl::Status s = CheckNotNegative(request.sigma_margin(), "sigma_margin");
    if (!s.ok()) return s;
    settings.sigma_margin = request.sigma_margin();
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<ObjectId>> IdsFromProto(
    const google::protobuf::RepeatedField<uint32_t>& ids, std::string_view field) {
  std::vector<ObjectId> result;
  result.reserve(ids.size());
  for (int i = 0; i < ids.size(); ++i) {
    const auto id = ObjectIdFromProto(ids[i], field, i);
    if (!id.ok()) return id.status();
    result.push_back(*id);
  }
  std::sort(result.begin(), result.end());
  result.erase(std::unique(result.begin(), result.end()), result.end());
  return result;
}

// The one position field that is set, its points, before their values are read.
struct Positions {
  const char* field;
  size_t count;
};

absl::StatusOr<Positions> FindPositions(const v1::QueryPointsRequest& r,
                                        const QueryLimits& limits) {
  const int given =
      !r.positions_f32().empty() + !r.positions_f64().empty() + (r.positions_xyz_size() > 0);
  if (given > 1) {
    return InvalidField("positions_f32", -1, absl::StrCat(given, " position fields"),
                        "one of positions_f32, positions_f64, positions_xyz");
  }
  if (given == 0) {
    return InvalidField("positions_f32", -1, "0 points", absl::StrCat("1 to ", limits.max_points));
  }
  Positions positions{};
  absl::StatusOr<size_t> n;
  size_t limit = limits.max_points;
  if (!r.positions_f32().empty()) {
    positions.field = "positions_f32";
    n = ElementCount(r.positions_f32(), sizeof(float), 3, positions.field);
  } else if (!r.positions_f64().empty()) {
    positions.field = "positions_f64";
    n = ElementCount(r.positions_f64(), sizeof(double), 3, positions.field);
  } else {
    positions.field = "positions_xyz";
    limit = limits.max_debug_points;
    if (r.positions_xyz_size() % 3 != 0) {
      return InvalidField(positions.field, -1, absl::StrCat(r.positions_xyz_size(), " values"),
                          "a multiple of 3 (x, y, z)");
    }
    n = r.positions_xyz_size() / 3;
  }
  if (!n.ok()) return n.status();
  positions.count = *n;
  if (*n > limit) {
    return InvalidField(positions.field, -1, absl::StrCat(*n, " points"),
                        absl::StrCat("at most ", limit, " a call"));
  }
  return positions;
}

absl::StatusOr<Eigen::Matrix3Xd> PointsFromProto(const v1::QueryPointsRequest& r,
                                                 const Positions& positions) {
  if (!r.positions_f32().empty()) {
    const auto points = DecodePoints3f(r.positions_f32(), positions.field);
    if (!points.ok()) return points.status();
    return Eigen::Matrix3Xd(points->cast<double>());
  }
  if (!r.positions_f64().empty()) return DecodePoints3d(r.positions_f64(), positions.field);
  const absl::Span<const double> values(r.positions_xyz().data(), r.positions_xyz_size());
  if (absl::Status s = CheckFinite(values, 3, positions.field); !s.ok()) return s;
  return Eigen::Matrix3Xd(Eigen::Map<const Eigen::Matrix3Xd>(values.data(), 3, positions.count));
}

}  // namespace

absl::StatusOr<Layers> LayersFromProto(const v1::LayerSelection& in, std::string_view field) {
  Layers layers;
  layers.static_only = in.static_only();
  auto only = IdsFromProto(in.only_objects(), Path(field, "only_objects"));
  if (!only.ok()) return only.status();
  layers.only_objects = *std::move(only);
  auto without = IdsFromProto(in.without_objects(), Path(field, "without_objects"));
  if (!without.ok()) return without.status();
  layers.without_objects = *std::move(without);
  if (layers.static_only + !layers.only_objects.empty() + !layers.without_objects.empty() > 1) {
    return InvalidField(field, -1, "several selections",
                        "one of static_only, only_objects, without_objects");
  }
  return layers;
}

absl::StatusOr<Consistency> ConsistencyFromProto(const v1::Consistency& in,
                                                 const QueryLimits& limits,
                                                 std::string_view field) {
  if (!std::isfinite(in.wait_s()) || in.wait_s() < 0 || in.wait_s() > limits.max_wait_s) {
    return InvalidField(Path(field, "wait_s"), -1, absl::StrCat(in.wait_s()),
                        absl::StrCat("0 to ", limits.max_wait_s, " seconds"));
  }
  Consistency consistency;
  consistency.min_revision = in.min_revision();
  consistency.epoch = in.epoch();
  consistency.pin_id = in.pin_id();
  consistency.wait_s = in.wait_s();
  return consistency;
}

absl::StatusOr<PointsQuery> PointsQueryFromProto(const v1::QueryPointsRequest& r,
                                                 const QueryLimits& limits) {
  PointsQuery query;
  query.gradients = r.gradients();
  query.objects = r.objects();
  query.sigmas = r.sigmas();
  query.unknown_distances = r.unknown_distances();
  if (absl::Status s = AddressFromProto(r, limits, query.settings); !s.ok()) return s;
  if (absl::Status s = DistanceSettingsFromProto(r, query.settings); !s.ok()) return s;
  const auto positions = FindPositions(r, limits);
  if (!positions.ok()) return positions.status();
  auto points = PointsFromProto(r, *positions);
  if (!points.ok()) return points.status();
  query.points_W = *std::move(points);
  auto horizons = DecodeArray<float>(r.horizons_f32(), 1, "horizons_f32");
  if (!horizons.ok()) return horizons.status();
  if (!horizons->empty()) {
    if (horizons->size() != positions->count) {
      return InvalidField("horizons_f32", -1, absl::StrCat(horizons->size(), " horizons"),
                          absl::StrCat(positions->count, " (one a point) or none"));
    }
    if (r.time_case() != v1::QueryPointsRequest::TIME_NOT_SET) {
      return InvalidField("horizons_f32", -1, "horizons next to at_ns or horizon_s",
                          "only one of them");
    }
    query.horizons_s = *std::move(horizons);
  }
  return query;
}

absl::StatusOr<ObjectsQuery> ObjectsQueryFromProto(const v1::ListObjectsRequest& r,
                                                   const QueryLimits& limits) {
  ObjectsQuery query;
  query.include_history = r.include_history();
  if (absl::Status s = AddressFromProto(r, limits, query.settings); !s.ok()) return s;
  return query;
}

absl::StatusOr<SliceQuery> SliceQueryFromProto(const v1::GetSliceRequest& r,
                                               const QueryLimits& limits) {
  SliceQuery query;
  query.z_m = r.z_m();
  query.resolution_m = r.resolution_m();
  query.gradients = r.gradients();
  if (absl::Status s = AddressFromProto(r, limits, query.settings); !s.ok()) return s;
  if (absl::Status s = DistanceSettingsFromProto(r, query.settings); !s.ok()) return s;
  if (absl::Status s = CheckFiniteValue(r.z_m(), "z_m"); !s.ok()) return s;
  if (absl::Status s = CheckNotNegative(r.resolution_m(), "resolution_m"); !s.ok()) return s;
  if (r.has_bounds()) {
    const auto bounds = BoxFromProto(r.bounds(), "bounds");
    if (!bounds.ok()) return bounds.status();
    query.bounds = *bounds;
  }
  return query;
}

absl::StatusOr<RegionQuery> RegionQueryFromProto(const v1::GetRegionRequest& r,
                                                 const QueryLimits& limits) {
  RegionQuery query;
  query.resolution_m = r.resolution_m();
  query.gradients = r.gradients();
  query.objects = r.objects();
  query.known_only = r.known_only();
  if (absl::Status s = AddressFromProto(r, limits, query.settings); !s.ok()) return s;
  if (absl::Status s = DistanceSettingsFromProto(r, query.settings); !s.ok()) return s;
  if (absl::Status s = CheckNotNegative(r.resolution_m(), "resolution_m"); !s.ok()) return s;
  if (!r.has_bounds()) return InvalidField("bounds", -1, "nothing", "a box");
  const auto bounds = BoxFromProto(r.bounds(), "bounds");
  if (!bounds.ok()) return bounds.status();
  query.bounds = *bounds;
  return query;
}

}  // namespace clearance::wire
