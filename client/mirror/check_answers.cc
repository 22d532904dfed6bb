#include "client/mirror/check_answers.h"

#include <cmath>
#include <string>
#include <utility>

#include "absl/numeric/int128.h"
#include "absl/strings/str_format.h"
#include "client/mirror/answers.h"
#include "proto/wire/geometry.h"
#include "proto/wire/status_details.h"
#include "server/query/trajectory_check.h"

namespace clearance::client {
namespace {

std::vector<ObjectId> IdsOf(const std::vector<uint32_t>& ids) {
  std::vector<ObjectId> result;
  for (const uint32_t id : ids) result.emplace_back(static_cast<uint16_t>(id));
  return result;
}

clearance::CheckOptions OptionsOf(const CheckOptions& options) {
  clearance::CheckOptions result;
  result.margin_m = options.margin_m;
  result.unknown_as_occupied = !options.unknown_as_free;
  result.sigma_margin = options.sigma_margin;
  result.layers = {options.static_only, IdsOf(options.only_objects),
                   IdsOf(options.without_objects)};
  return result;
}

std::vector<RobotSphere> RobotOf(const std::vector<Sphere>& spheres) {
  std::vector<RobotSphere> robot;
  robot.reserve(spheres.size());
  for (const Sphere& s : spheres) robot.push_back({s.center_R.cast<double>(), s.radius_m});
  return robot;
}

// Poses as they reach the server: through quaternions. Checked on the way.
absl::StatusOr<std::vector<Pose>> PosesOf(const std::vector<Pose>& T_W_R,
                                          const std::string& field) {
  std::string bytes;
  bytes.reserve(T_W_R.size() * 7 * sizeof(double));
  for (const Pose& pose : T_W_R) wire::AppendPose(pose, &bytes);
  return wire::DecodePoses(bytes, field);
}

// Seconds from the view's stamp to what times count from.
double ReferenceOf(const MapView& view, const CheckOptions& options) {
  if (options.reference_ns == 0) return 0;
  return static_cast<double>(absl::int128(options.reference_ns) - absl::int128(view.stamp_ns)) *
         1e-9;
}

int64_t ReferenceNs(const MapView& view, const CheckOptions& options) {
  return options.reference_ns == 0 ? view.stamp_ns : options.reference_ns;
}

uint32_t IdOf(const MapView& view, int object) {
  return object < 0 ? 0 : view.objects[static_cast<size_t>(object)].id.value();
}

}  // namespace

absl::StatusOr<TrajectoryAnswers> AnswerTrajectories(const MapView& view,
                                                     const std::vector<Sphere>& spheres,
                                                     const std::vector<Trajectory>& trajectories,
                                                     const CheckOptions& options) {
  const double reference_s = ReferenceOf(view, options);
  std::vector<RobotPath> paths;
  paths.reserve(trajectories.size());
  for (size_t i = 0; i < trajectories.size(); ++i) {
    absl::StatusOr<std::vector<Pose>> poses =
        PosesOf(trajectories[i].T_W_R, absl::StrFormat("trajectories[%d].T_W_R", i));
    if (!poses.ok()) return poses.status();
    RobotPath& path = paths.emplace_back();
    path.T_W_R = *std::move(poses);
    path.horizons_s.reserve(trajectories[i].times_s.size());
    for (const double t : trajectories[i].times_s) path.horizons_s.push_back(reference_s + t);
  }
  const std::vector<RobotSphere> robot = RobotOf(spheres);
  const clearance::CheckOptions check = OptionsOf(options);
  if (absl::Status s = ValidateCheck(view, robot, paths, check); !s.ok()) return s;
  TrajectoryAnswers answers;
  answers.stamp = MapStampOf(view);
  answers.reference_ns = ReferenceNs(view, options);
  const std::vector<PathCheck> checks = CheckPaths(view, robot, paths, check);
  answers.results.reserve(checks.size());
  for (size_t i = 0; i < checks.size(); ++i) {
    const PathCheck& c = checks[i];
    // Back to the trajectory's own times.
    const double offset_s = trajectories[i].times_s[0] - paths[i].horizons_s[0];
    TrajectoryResult& result = answers.results.emplace_back();
    result.collides = c.collides;
    if (c.collides) result.first_collision_s = c.first_collision_s + offset_s;
    if (c.last_valid_s) result.last_valid_s = *c.last_valid_s + offset_s;
    result.last_valid_index = c.last_valid_index;
    result.min_clearance_m = c.min_clearance_m;
    result.min_clearance_s = c.min_clearance_s + offset_s;
    result.object_id = IdOf(view, c.object);
    if (c.object >= 0) result.twist = c.twist;
    result.unknown_decides = c.unknown_decides;
  }
  return answers;
}

absl::StatusOr<SphereAnswers> AnswerSpheres(const MapView& view, const std::vector<Sphere>& spheres,
                                            const std::vector<Pose>& T_W_R,
                                            const std::vector<double>& times_s,
                                            const CheckOptions& options) {
  const double reference_s = ReferenceOf(view, options);
  const absl::StatusOr<std::vector<Pose>> poses = PosesOf(T_W_R, "T_W_R");
  if (!poses.ok()) return poses.status();
  std::vector<double> horizons_s(T_W_R.size(), reference_s);
  if (!times_s.empty()) {
    horizons_s.clear();
    for (const double t : times_s) horizons_s.push_back(reference_s + t);
  }
  const std::vector<RobotSphere> robot = RobotOf(spheres);
  const clearance::CheckOptions check = OptionsOf(options);
  if (absl::Status s = ValidateCheck(view, robot, *poses, horizons_s, check); !s.ok()) return s;
  PoseChecks checks = CheckPoses(view, robot, *poses, horizons_s, check);
  SphereAnswers answers;
  answers.stamp = MapStampOf(view);
  answers.reference_ns = ReferenceNs(view, options);
  answers.collides = std::move(checks.collides);
  answers.clearances_m = std::move(checks.clearances_m);
  answers.sphere_indices = std::move(checks.sphere_indices);
  for (const int object : checks.objects) answers.object_ids.push_back(IdOf(view, object));
  return answers;
}

}  // namespace clearance::client
