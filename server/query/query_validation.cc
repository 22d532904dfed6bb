#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_format.h"
#include "server/query/point_query.h"

namespace clearance {
namespace {

bool HorizonFits(const MapView& view, double horizon_s) {
  return horizon_s >= 0 && horizon_s <= view.config.max_horizon_s;  // NaN does not
}

absl::Status CheckHorizon(const MapView& view, const std::string& field, double horizon_s) {
  if (!std::isfinite(horizon_s)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is %g: must be finite", field, horizon_s));
  }
  if (!HorizonFits(view, horizon_s)) {
    return absl::OutOfRangeError(
        absl::StrFormat("%s is %g s after the map's stamp %d ns: must be 0 to %g (max_horizon_s)",
                        field, horizon_s, view.stamp_ns, view.config.max_horizon_s));
  }
  return absl::OkStatus();
}

absl::Status CheckNotNegative(const std::string& field, double value) {
  if (std::isfinite(value) && value >= 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %g: must be finite and not negative", field, value));
}

std::string IdsOf(const MapView& view) {
  std::string ids;
  for (const ObjectView& object : view.objects) {
    ids += absl::StrFormat("%s%d", ids.empty() ? "" : ", ", object.id.value());
    if (ids.size() > 200) return ids + ", ...";
  }
  return ids.empty() ? "none" : ids;
}

absl::Status CheckIds(const MapView& view, const std::string& field,
                      const std::vector<ObjectId>& ids) {
  for (size_t i = 0; i < ids.size(); ++i) {
    const bool known = std::any_of(view.objects.begin(), view.objects.end(),
                                   [&](const ObjectView& object) { return object.id == ids[i]; });
    if (!known) {
      return absl::NotFoundError(absl::StrFormat("%s[%d]: no object %d; the map has: %s", field, i,
                                                 ids[i].value(), IdsOf(view)));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ValidateQuery(const MapView& view, Eigen::Index points, const QueryOptions& options) {
  if (!options.horizons_s.empty()) {
    if (static_cast<Eigen::Index>(options.horizons_s.size()) != points) {
      return absl::InvalidArgumentError(
          absl::StrFormat("horizons has %d values: must be one for each of the %d points",
                          options.horizons_s.size(), points));
    }
    for (size_t i = 0; i < options.horizons_s.size(); ++i) {
      if (HorizonFits(view, options.horizons_s[i])) continue;
      return CheckHorizon(view, absl::StrFormat("horizons[%d]", i), options.horizons_s[i]);
    }
  } else {
    absl::Status status = CheckHorizon(view, "horizon_s", options.horizon_s);
    if (!status.ok()) return status;
  }
  absl::Status status = CheckNotNegative("sigma_margin", options.sigma_margin);
  if (!status.ok()) return status;
  status = CheckNotNegative("max_distance_m", options.max_distance_m);
  if (!status.ok()) return status;
  if (options.max_distance_m > view.config.max_distance_m) {
    return absl::InvalidArgumentError(
        absl::StrFormat("max_distance_m is %g: must be at most the map's, %g",
                        options.max_distance_m, view.config.max_distance_m));
  }
  const LayerSelection& layers = options.layers;
  if (layers.static_only && (!layers.only_objects.empty() || !layers.without_objects.empty())) {
    return absl::InvalidArgumentError(
        "layers.static_only is set: only_objects and without_objects must be empty");
  }
  status = CheckIds(view, "layers.only_objects", layers.only_objects);
  if (!status.ok()) return status;
  return CheckIds(view, "layers.without_objects", layers.without_objects);
}

}  // namespace clearance
