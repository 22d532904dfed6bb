#include "proto/wire/check.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

absl::Status CheckCount(std::string_view field, size_t got, size_t limit) {
  if (got >= 1 && got <= limit) return absl::OkStatus();
  return InvalidField(field, -1, absl::StrCat(got), absl::StrCat("1 to ", limit, " a call"));
}

absl::StatusOr<std::vector<Ball>> BallsFromProto(const std::string& bytes, size_t limit) {
  constexpr const char* kField = "spheres_f32";
  const absl::StatusOr<size_t> n = ElementCount(bytes, sizeof(float), 4, kField);
  if (!n.ok()) return n.status();
  if (absl::Status s = CheckCount(kField, *n, limit); !s.ok()) return s;
  const absl::StatusOr<std::vector<float>> values = DecodeArray<float>(bytes, 4, kField);
  if (!values.ok()) return values.status();
  std::vector<Ball> balls;
  balls.reserve(*n);
  for (size_t i = 0; i < *n; ++i) {
    const float* v = values->data() + 4 * i;
    if (!(v[3] > 0)) {
      return InvalidField(kField, static_cast<int64_t>(i), absl::StrCat("radius ", v[3]),
                          "a radius above 0 m");
    }
    balls.push_back({Eigen::Vector3d(v[0], v[1], v[2]), v[3]});
  }
  return balls;
}

// The fields that both checks share by name.
template <typename Request>
absl::StatusOr<CheckSettings> CheckFromProto(const Request& r, const CheckLimits& limits) {
  CheckSettings check;
  auto map = NameFromProto(r.map(), "map");
  if (!map.ok()) return map.status();
  check.settings.map = *std::move(map);
  if (r.reference_ns() != 0) check.settings.time.reference_ns = r.reference_ns();
  const auto consistency = ConsistencyFromProto(r.consistency(), limits.query, "consistency");
  if (!consistency.ok()) return consistency.status();
  check.settings.consistency = *consistency;
  auto layers = LayersFromProto(r.layers(), "layers");
  if (!layers.ok()) return layers.status();
  check.settings.layers = *std::move(layers);
  for (const auto& [field, value, out] :
       {std::tuple("margin_m", r.margin_m(), &check.margin_m),
        std::tuple("sigma_margin", r.sigma_margin(), &check.settings.sigma_margin)}) {
    if (!std::isfinite(value) || value < 0) {
      return InvalidField(field, -1, absl::StrCat(value), "a finite number, 0 or more");
    }
    *out = value;
  }
  if (!v1::UnknownPolicy_IsValid(r.unknown_policy())) {
    return InvalidField("unknown_policy", -1, absl::StrCat(static_cast<int>(r.unknown_policy())),
                        "UNKNOWN_POLICY_AS_FREE or UNKNOWN_POLICY_AS_OCCUPIED");
  }
  check.unknown_as_free = r.unknown_policy() == v1::UNKNOWN_POLICY_AS_FREE;
  auto balls = BallsFromProto(r.spheres_f32(), limits.max_spheres);
  if (!balls.ok()) return balls.status();
  check.spheres = *std::move(balls);
  return check;
}

absl::Status CheckStates(size_t poses, size_t spheres, const CheckLimits& limits) {
  if (poses * spheres <= limits.max_states) return absl::OkStatus();
  return InvalidField("spheres_f32", -1, absl::StrCat(spheres, " spheres at ", poses, " waypoints"),
                      absl::StrCat("at most ", limits.max_states, " of both multiplied a call"));
}

absl::StatusOr<TimedPath> PathFromProto(const v1::Trajectory& in, const std::string& field) {
  TimedPath path;
  auto poses = DecodePoses(in.waypoints_f64(), Path(field, "waypoints_f64"));
  if (!poses.ok()) return poses.status();
  path.T_W_R = *std::move(poses);
  if (path.T_W_R.empty()) {
    return InvalidField(Path(field, "waypoints_f64"), -1, "0 waypoints", "at least 1");
  }
  const std::string times_field = Path(field, "times_f64");
  auto times = DecodeArray<double>(in.times_f64(), 1, times_field);
  if (!times.ok()) return times.status();
  path.times_s = *std::move(times);
  if (path.times_s.size() != path.T_W_R.size()) {
    return InvalidField(times_field, -1, absl::StrCat(path.times_s.size(), " times"),
                        absl::StrCat(path.T_W_R.size(), ", one a waypoint"));
  }
  for (size_t i = 1; i < path.times_s.size(); ++i) {
    if (path.times_s[i] > path.times_s[i - 1]) continue;
    return InvalidField(times_field, static_cast<int64_t>(i),
                        absl::StrCat(path.times_s[i], " after ", path.times_s[i - 1]),
                        "strictly ascending times");
  }
  return path;
}

}  // namespace

absl::StatusOr<TrajectoriesQuery> TrajectoriesQueryFromProto(const v1::CheckTrajectoriesRequest& r,
                                                             const CheckLimits& limits) {
  TrajectoriesQuery query;
  auto check = CheckFromProto(r, limits);
  if (!check.ok()) return check.status();
  query.check = *std::move(check);
  absl::Status s = CheckCount("trajectories", r.trajectories_size(), limits.max_trajectories);
  if (!s.ok()) return s;
  size_t waypoints = 0;
  for (int i = 0; i < r.trajectories_size(); ++i) {
    const std::string field = PathAt("", "trajectories", i);
    waypoints += r.trajectories(i).waypoints_f64().size() / (7 * sizeof(double));
    if (waypoints > limits.max_waypoints) {
      return InvalidField(Path(field, "waypoints_f64"), -1,
                          absl::StrCat("more than ", limits.max_waypoints,
                                       " waypoints in all trajectories up to this one"),
                          absl::StrCat("at most ", limits.max_waypoints, " a call"));
    }
    auto path = PathFromProto(r.trajectories(i), field);
    if (!path.ok()) return path.status();
    query.trajectories.push_back(*std::move(path));
  }
  s = CheckStates(waypoints, query.check.spheres.size(), limits);
  if (!s.ok()) return s;
  return query;
}

absl::StatusOr<SpheresQuery> SpheresQueryFromProto(const v1::CheckSpheresRequest& r,
                                                   const CheckLimits& limits) {
  SpheresQuery query;
  auto check = CheckFromProto(r, limits);
  if (!check.ok()) return check.status();
  query.check = *std::move(check);
  const auto n = ElementCount(r.poses_f64(), sizeof(double), 7, "poses_f64");
  if (!n.ok()) return n.status();
  if (absl::Status s = CheckCount("poses_f64", *n, limits.max_waypoints); !s.ok()) return s;
  absl::Status states = CheckStates(*n, query.check.spheres.size(), limits);
  if (!states.ok()) return states;
  auto poses = DecodePoses(r.poses_f64(), "poses_f64");
  if (!poses.ok()) return poses.status();
  query.T_W_R = *std::move(poses);
  auto times = DecodeArray<double>(r.times_f64(), 1, "times_f64");
  if (!times.ok()) return times.status();
  query.times_s = *std::move(times);
  if (!query.times_s.empty() && query.times_s.size() != query.T_W_R.size()) {
    return InvalidField("times_f64", -1, absl::StrCat(query.times_s.size(), " times"),
                        absl::StrCat(query.T_W_R.size(), " (one a pose) or none"));
  }
  return query;
}

absl::StatusOr<PinQuery> PinQueryFromProto(const v1::PinRevisionRequest& r,
                                           const QueryLimits& limits) {
  PinQuery query;
  auto map = NameFromProto(r.map(), "map");
  if (!map.ok()) return map.status();
  query.settings.map = *std::move(map);
  const auto consistency = ConsistencyFromProto(r.consistency(), limits, "consistency");
  if (!consistency.ok()) return consistency.status();
  query.settings.consistency = *consistency;
  if (!std::isfinite(r.ttl_s()) || r.ttl_s() < 0) {
    return InvalidField("ttl_s", -1, absl::StrCat(r.ttl_s()), "a finite number, 0 or more");
  }
  query.revision = r.revision();
  query.ttl_s = r.ttl_s();
  return query;
}

}  // namespace clearance::wire
