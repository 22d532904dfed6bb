#include "server/service/check_replies.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "server/query/trajectory_check.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

CheckOptions OptionsOf(const wire::CheckSettings& check, const std::function<bool()>& cancelled) {
  CheckOptions options;
  options.margin_m = check.margin_m;
  options.unknown_as_occupied = !check.unknown_as_free;
  options.sigma_margin = check.settings.sigma_margin;
  options.layers = {check.settings.layers.static_only, check.settings.layers.only_objects,
                    check.settings.layers.without_objects};
  options.cancelled = cancelled;
  return options;
}

std::vector<RobotSphere> RobotOf(const wire::CheckSettings& check) {
  std::vector<RobotSphere> robot;
  robot.reserve(check.spheres.size());
  for (const wire::Ball& ball : check.spheres) robot.push_back({ball.centre_R, ball.radius_m});
  return robot;
}

// The view's times of times that count from the reference.
absl::StatusOr<std::vector<double>> HorizonsOf(const MapView& view, const wire::QueryTime& time,
                                               const std::vector<double>& times_s,
                                               const std::string& field) {
  std::vector<double> horizons_s;
  horizons_s.reserve(times_s.size());
  for (size_t i = 0; i < times_s.size(); ++i) {
    const absl::StatusOr<double> horizon_s =
        ResolveHorizon(view, time, times_s[i], absl::StrFormat("%s[%d]", field, i));
    if (!horizon_s.ok()) return horizon_s.status();
    horizons_s.push_back(*horizon_s);
  }
  return horizons_s;
}

absl::Status Cancelled() {
  return absl::CancelledError("the client cancelled or its deadline passed");
}

}  // namespace

absl::StatusOr<v1::CheckTrajectoriesResponse> AnswerTrajectories(
    const MapView& view, const wire::TrajectoriesQuery& query,
    const std::function<bool()>& cancelled) {
  const wire::QueryTime& time = query.check.settings.time;
  std::vector<RobotPath> paths;
  paths.reserve(query.trajectories.size());
  for (size_t i = 0; i < query.trajectories.size(); ++i) {
    absl::StatusOr<std::vector<double>> horizons =
        HorizonsOf(view, time, query.trajectories[i].times_s,
                   absl::StrFormat("trajectories[%d].times_f64", i));
    if (!horizons.ok()) return horizons.status();
    paths.push_back({query.trajectories[i].T_W_R, *std::move(horizons)});
  }
  const std::vector<RobotSphere> robot = RobotOf(query.check);
  const CheckOptions options = OptionsOf(query.check, cancelled);
  if (absl::Status s = ValidateCheck(view, robot, paths, options); !s.ok()) return s;
  const std::vector<PathCheck> checks = CheckPaths(view, robot, paths, options);
  if (cancelled && cancelled()) return Cancelled();

  v1::CheckTrajectoriesResponse response;
  ToProto(StampOf(view), response.mutable_stamp());
  response.set_reference_ns(ReferenceNs(view, time));
  for (size_t i = 0; i < checks.size(); ++i) {
    const PathCheck& check = checks[i];
    // Back to the trajectory's own times.
    const double offset_s = query.trajectories[i].times_s[0] - paths[i].horizons_s[0];
    v1::TrajectoryResult* result = response.add_results();
    result->set_collides(check.collides);
    if (check.collides) result->set_first_collision_s(check.first_collision_s + offset_s);
    if (check.last_valid_s) result->set_last_valid_s(*check.last_valid_s + offset_s);
    if (check.last_valid_index) result->set_last_valid_index(*check.last_valid_index);
    result->set_min_clearance_m(check.min_clearance_m);
    result->set_min_clearance_s(check.min_clearance_s + offset_s);
    if (check.object >= 0) {
      result->set_object_id(view.objects[check.object].id.value());
      wire::ToProto(check.twist, result->mutable_twist());
    }
    result->set_unknown_decides(check.unknown_decides);
  }
  return response;
}

absl::StatusOr<v1::CheckSpheresResponse> AnswerSpheres(const MapView& view,
                                                       const wire::SpheresQuery& query,
                                                       const std::function<bool()>& cancelled) {
  const wire::QueryTime& time = query.check.settings.time;
  // Without times all are asked at the reference.
  const std::vector<double> times_s =
      query.times_s.empty() ? std::vector<double>(query.T_W_R.size(), 0.0) : query.times_s;
  const absl::StatusOr<std::vector<double>> horizons_s =
      HorizonsOf(view, time, times_s, query.times_s.empty() ? "reference_ns" : "times_f64");
  if (!horizons_s.ok()) return horizons_s.status();
  const std::vector<RobotSphere> robot = RobotOf(query.check);
  const CheckOptions options = OptionsOf(query.check, cancelled);
  absl::Status valid = ValidateCheck(view, robot, query.T_W_R, *horizons_s, options);
  if (!valid.ok()) return valid;
  const PoseChecks checks = CheckPoses(view, robot, query.T_W_R, *horizons_s, options);
  if (cancelled && cancelled()) return Cancelled();

  v1::CheckSpheresResponse response;
  ToProto(StampOf(view), response.mutable_stamp());
  response.set_reference_ns(ReferenceNs(view, time));
  response.set_collides_u8(wire::EncodeArray(checks.collides));
  response.set_clearances_f32(wire::EncodeArray(checks.clearances_m));
  response.set_sphere_indices_u32(wire::EncodeArray(checks.sphere_indices));
  std::vector<uint32_t> ids;
  ids.reserve(checks.objects.size());
  for (const int object : checks.objects) {
    ids.push_back(object < 0 ? 0 : view.objects[object].id.value());
  }
  response.set_object_ids_u32(wire::EncodeArray(ids));
  return response;
}

}  // namespace clearance
