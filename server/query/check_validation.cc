#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_format.h"
#include "server/query/point_query.h"
#include "server/query/trajectory_check.h"

namespace clearance {
namespace {

absl::Status NotNegative(const char* field, double value) {
  if (std::isfinite(value) && value >= 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: got %g; expected a finite number, 0 or more", field, value));
}

absl::Status TooMany(const std::string& field, size_t got, size_t limit) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: got %d; expected 1 to %d a call", field, got, limit));
}

absl::Status CheckHorizon(const MapView& view, const std::string& field, double horizon_s) {
  if (!std::isfinite(horizon_s)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: got %g; expected a finite number", field, horizon_s));
  }
  if (horizon_s < 0) {
    return absl::OutOfRangeError(absl::StrFormat(
        "%s: the time is %.9g s before the map's stamp %d ns; expected 0 to %g s after it", field,
        -horizon_s, view.stamp_ns, view.config.max_horizon_s));
  }
  if (horizon_s > view.config.max_horizon_s) {
    return absl::OutOfRangeError(
        absl::StrFormat("%s: the time is %.9g s after the map's stamp %d ns; limit %g s", field,
                        horizon_s, view.stamp_ns, view.config.max_horizon_s));
  }
  return absl::OkStatus();
}

absl::Status CheckPose(const std::string& field, const Pose& pose) {
  // The look-ups take what is out of reach for unknown; the way between two such poses has no end.
  if (pose.matrix().allFinite() && pose.translation().cwiseAbs().maxCoeff() <= 1e9) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: got the position (%g, %g, %g); expected finite values within 1e9 m", field,
      pose.translation().x(), pose.translation().y(), pose.translation().z()));
}

absl::Status CheckShared(const MapView& view, const std::vector<RobotSphere>& spheres,
                         const CheckOptions& options, const CheckLimits& limits) {
  if (spheres.empty() || spheres.size() > limits.max_spheres) {
    return TooMany("spheres", spheres.size(), limits.max_spheres);
  }
  for (size_t i = 0; i < spheres.size(); ++i) {
    const RobotSphere& s = spheres[i];
    if (s.centre_R.allFinite() && s.centre_R.norm() <= 1e6 && std::isfinite(s.radius_m) &&
        s.radius_m > 0) {
      continue;
    }
    return absl::InvalidArgumentError(absl::StrFormat(
        "spheres[%d]: got (%g, %g, %g), radius %g; expected finite values and a radius above 0", i,
        s.centre_R.x(), s.centre_R.y(), s.centre_R.z(), s.radius_m));
  }
  if (absl::Status s = NotNegative("margin_m", options.margin_m); !s.ok()) return s;
  QueryOptions query;
  query.layers = options.layers;
  query.sigma_margin = options.sigma_margin;
  return ValidateQuery(view, 1, query);
}

absl::Status CheckCost(double travel_m, size_t states, const CheckLimits& limits) {
  if (states > limits.max_states) {
    return absl::InvalidArgumentError(
        absl::StrFormat("spheres: got %d states (poses times spheres); expected at most %d a call",
                        states, limits.max_states));
  }
  if (travel_m > limits.max_travel_m) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "trajectories: got %g m of way, summed over trajectories and spheres; expected at most %g "
        "m a call",
        travel_m, limits.max_travel_m));
  }
  return absl::OkStatus();
}

double TravelOf(const RobotPath& path, double arms_m, size_t spheres) {
  double travel_m = 0;
  for (size_t i = 0; i + 1 < path.T_W_R.size(); ++i) {
    const Pose &a = path.T_W_R[i], &b = path.T_W_R[i + 1];
    travel_m += static_cast<double>(spheres) * (a.translation() - b.translation()).norm();
    travel_m +=
        arms_m * Eigen::Quaterniond(a.linear()).angularDistance(Eigen::Quaterniond(b.linear()));
  }
  return travel_m;
}

}  // namespace

absl::Status ValidateCheck(const MapView& view, const std::vector<RobotSphere>& spheres,
                           const std::vector<RobotPath>& paths, const CheckOptions& options,
                           const CheckLimits& limits) {
  if (absl::Status s = CheckShared(view, spheres, options, limits); !s.ok()) return s;
  if (paths.empty() || paths.size() > limits.max_paths) {
    return TooMany("trajectories", paths.size(), limits.max_paths);
  }
  double arms_m = 0, travel_m = 0;
  for (const RobotSphere& sphere : spheres) arms_m += sphere.centre_R.norm();
  size_t poses = 0;
  for (size_t p = 0; p < paths.size(); ++p) {
    const RobotPath& path = paths[p];
    const std::string field = absl::StrFormat("trajectories[%d]", p);
    poses += path.T_W_R.size();
    if (path.T_W_R.empty() || poses > limits.max_poses) {
      return TooMany(field + ".waypoints (all trajectories together)", poses, limits.max_poses);
    }
    if (path.horizons_s.size() != path.T_W_R.size()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s.times: got %d; expected %d, one a waypoint", field,
                          path.horizons_s.size(), path.T_W_R.size()));
    }
    for (size_t i = 0; i < path.T_W_R.size(); ++i) {
      absl::Status s = CheckPose(absl::StrFormat("%s.waypoints[%d]", field, i), path.T_W_R[i]);
      if (!s.ok()) return s;
      const std::string time = absl::StrFormat("%s.times[%d]", field, i);
      s = CheckHorizon(view, time, path.horizons_s[i]);
      if (!s.ok()) return s;
      if (i > 0 && !(path.horizons_s[i] > path.horizons_s[i - 1])) {
        return absl::InvalidArgumentError(
            absl::StrFormat("%s: got %.9g after %.9g; expected strictly ascending times", time,
                            path.horizons_s[i], path.horizons_s[i - 1]));
      }
    }
    travel_m += TravelOf(path, arms_m, spheres.size());
  }
  return CheckCost(travel_m, poses * spheres.size(), limits);
}

absl::Status ValidateCheck(const MapView& view, const std::vector<RobotSphere>& spheres,
                           const std::vector<Pose>& T_W_R, const std::vector<double>& horizons_s,
                           const CheckOptions& options, const CheckLimits& limits) {
  if (absl::Status s = CheckShared(view, spheres, options, limits); !s.ok()) return s;
  if (T_W_R.empty() || T_W_R.size() > limits.max_poses) {
    return TooMany("poses", T_W_R.size(), limits.max_poses);
  }
  if (!horizons_s.empty() && horizons_s.size() != T_W_R.size()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "times: got %d; expected %d, one a pose, or none", horizons_s.size(), T_W_R.size()));
  }
  for (size_t i = 0; i < T_W_R.size(); ++i) {
    if (absl::Status s = CheckPose(absl::StrFormat("poses[%d]", i), T_W_R[i]); !s.ok()) return s;
  }
  for (size_t i = 0; i < horizons_s.size(); ++i) {
    absl::Status s = CheckHorizon(view, absl::StrFormat("times[%d]", i), horizons_s[i]);
    if (!s.ok()) return s;
  }
  return CheckCost(0, T_W_R.size() * spheres.size(), limits);
}

}  // namespace clearance
