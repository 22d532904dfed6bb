// Checks of robots: options -> requests, replies -> answers.
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/convert.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"

namespace clearance::client {
namespace {

template <typename Request>
void SetCheck(const CheckOptions& options, const std::vector<Sphere>& spheres, Request* request) {
  request->set_map(options.map);
  std::vector<float> values;
  values.reserve(spheres.size() * 4);
  for (const Sphere& s : spheres) {
    values.insert(values.end(), {s.center_R.x(), s.center_R.y(), s.center_R.z(), s.radius_m});
  }
  request->set_spheres_f32(wire::EncodeArray(values));
  request->set_margin_m(options.margin_m);
  request->set_unknown_policy(options.unknown_as_free ? v1::UNKNOWN_POLICY_AS_FREE
                                                      : v1::UNKNOWN_POLICY_AS_OCCUPIED);
  request->set_sigma_margin(options.sigma_margin);
  SetLayers(options, request->mutable_layers());
  SetConsistency(options, request);
  request->set_reference_ns(options.reference_ns);
}

template <typename T>
absl::Status Take(const std::string& bytes, size_t n, const char* field, std::vector<T>* out) {
  if (bytes.size() != n * sizeof(T)) {
    return absl::DataLossError(absl::StrFormat(
        "the server's reply: %s has %d bytes, expected %d; do client and server match?", field,
        bytes.size(), n * sizeof(T)));
  }
  out->resize(n);
  if (n > 0) std::memcpy(out->data(), bytes.data(), bytes.size());
  return absl::OkStatus();
}

TrajectoryResult FromProto(const v1::TrajectoryResult& in) {
  TrajectoryResult result;
  result.collides = in.collides();
  result.first_collision_s = in.first_collision_s();
  if (in.has_last_valid_s()) result.last_valid_s = in.last_valid_s();
  if (in.has_last_valid_index()) result.last_valid_index = in.last_valid_index();
  result.min_clearance_m = in.min_clearance_m();
  result.min_clearance_s = in.min_clearance_s();
  result.object_id = in.object_id();
  result.twist = wire::TwistFromProto(in.twist(), "twist").value_or(Twist{});
  result.unknown_decides = in.unknown_decides();
  return result;
}

}  // namespace

void ToProto(const CheckOptions& options, const std::vector<Sphere>& spheres,
             v1::CheckTrajectoriesRequest* request) {
  SetCheck(options, spheres, request);
}

void ToProto(const CheckOptions& options, const std::vector<Sphere>& spheres,
             v1::CheckSpheresRequest* request) {
  SetCheck(options, spheres, request);
}

void ToProto(const Trajectory& trajectory, v1::Trajectory* out) {
  for (const Pose& pose : trajectory.T_W_R) wire::AppendPose(pose, out->mutable_waypoints_f64());
  out->set_times_f64(wire::EncodeArray(trajectory.times_s));
}

absl::StatusOr<TrajectoryAnswers> FromProto(const v1::CheckTrajectoriesResponse& reply, size_t n) {
  if (static_cast<size_t>(reply.results_size()) != n) {
    return absl::DataLossError(
        absl::StrFormat("the server's reply: %d results, expected %d; do client and server match?",
                        reply.results_size(), n));
  }
  TrajectoryAnswers answers;
  answers.stamp = FromProto(reply.stamp());
  answers.reference_ns = reply.reference_ns();
  for (const auto& result : reply.results()) answers.results.push_back(FromProto(result));
  return answers;
}

absl::StatusOr<SphereAnswers> FromProto(const v1::CheckSpheresResponse& reply, size_t n) {
  SphereAnswers answers;
  answers.stamp = FromProto(reply.stamp());
  answers.reference_ns = reply.reference_ns();
  for (const absl::Status& status :
       {Take(reply.collides_u8(), n, "collides_u8", &answers.collides),
        Take(reply.clearances_f32(), n, "clearances_f32", &answers.clearances_m),
        Take(reply.sphere_indices_u32(), n, "sphere_indices_u32", &answers.sphere_indices),
        Take(reply.object_ids_u32(), n, "object_ids_u32", &answers.object_ids)}) {
    if (!status.ok()) return status;
  }
  return answers;
}

}  // namespace clearance::client
