#include "proto/wire/object_state.h"

#include <cmath>
#include <vector>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

constexpr size_t kPoseValues = 12, kScrewValues = 6;
// What lies beyond is damage: a map reaches 10,000 km, and bounds of queries are floats.
constexpr double kMaxReach_m = 1e8, kMaxVelocity_mps = 1e10, kMaxRate_radps = 1e3;
constexpr double kMaxDeviation = 1e6;

absl::StatusOr<std::vector<double>> DecodeValues(const std::string& bytes, size_t count,
                                                 const std::string& field) {
  absl::StatusOr<std::vector<double>> values = DecodeArray<double>(bytes, count, field);
  if (values.ok() && values->size() != count) {
    return InvalidField(field, -1, absl::StrFormat("%d values", values->size()),
                        absl::StrFormat("%d", count));
  }
  return values;
}

absl::Status CheckDeviation(double value, const std::string& field) {
  if (value >= 0 && value <= kMaxDeviation) return absl::OkStatus();  // NaN is not
  return InvalidField(field, -1, absl::StrFormat("%g", value),
                      absl::StrFormat("0 to %g", kMaxDeviation));
}

}  // namespace

void ToProto(const ObjectState& state, v1::ObjectState* out) {
  v1::ObjectBrief* brief = out->mutable_brief();
  brief->set_object_id(state.id.value());
  brief->set_generation(state.generation);
  brief->set_class_name(state.class_name);
  brief->set_life_state(state.life_state);
  ToProto(state.T_W_L, brief->mutable_world_from_object());
  ToProto(state.twist, brief->mutable_twist());
  std::vector<double> values;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) values.push_back(state.T_W_L(row, column));
  }
  out->set_world_from_object_f64(EncodeArray(values));
  out->set_screw_f64(EncodeArray(absl::Span<const double>(state.screw_W.data(), kScrewValues)));
  out->set_position_sigma_m(state.position_sigma_m);
  out->set_velocity_sigma_mps(state.velocity_sigma_mps);
  out->set_first_seen_ns(state.first_seen_ns);
  out->set_last_seen_ns(state.last_seen_ns);
  out->set_observations(state.observations);
  out->set_source_id(state.source_id);
}

absl::StatusOr<ObjectState> ObjectStateFromProto(const v1::ObjectState& state,
                                                 std::string_view field) {
  ObjectState result;
  const v1::ObjectBrief& brief = state.brief();
  const absl::StatusOr<ObjectId> id =
      ObjectIdFromProto(brief.object_id(), Path(field, "brief.object_id"));
  if (!id.ok()) return id.status();
  result.id = *id;
  result.generation = brief.generation();
  if (!v1::LifeState_IsValid(brief.life_state()) ||
      brief.life_state() == v1::LIFE_STATE_UNSPECIFIED) {
    return InvalidField(Path(field, "brief.life_state"), -1,
                        absl::StrFormat("%d", brief.life_state()), "a state");
  }
  result.life_state = brief.life_state();
  result.class_name = brief.class_name();
  result.source_id = state.source_id();
  const absl::StatusOr<Twist> twist = TwistFromProto(brief.twist(), Path(field, "brief.twist"));
  if (!twist.ok()) return twist.status();
  result.twist = *twist;
  const std::string pose_field = Path(field, "world_from_object_f64");
  const auto pose = DecodeValues(state.world_from_object_f64(), kPoseValues, pose_field);
  if (!pose.ok()) return pose.status();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column)
      result.T_W_L(row, column) = (*pose)[row * 4 + column];
  }
  const Eigen::Matrix3d R = result.T_W_L.linear();
  const double off = (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off < kQuaternionTolerance) || R.determinant() < 0) {
    return InvalidField(pose_field, -1, absl::StrFormat("axes off by %g", off),
                        "a rotation, within 0.001");
  }
  const double reach_m = result.T_W_L.translation().cwiseAbs().maxCoeff();
  if (reach_m > kMaxReach_m) {
    return InvalidField(pose_field, -1, absl::StrFormat("an origin %g m away", reach_m),
                        absl::StrFormat("at most %g", kMaxReach_m));
  }
  const auto screw = DecodeValues(state.screw_f64(), kScrewValues, Path(field, "screw_f64"));
  if (!screw.ok()) return screw.status();
  for (size_t i = 0; i < kScrewValues; ++i) result.screw_W[i] = (*screw)[i];
  const double velocity = result.screw_W.head<3>().cwiseAbs().maxCoeff();
  const double rate = result.screw_W.tail<3>().cwiseAbs().maxCoeff();
  if (velocity > kMaxVelocity_mps || rate > kMaxRate_radps) {
    return InvalidField(Path(field, "screw_f64"), -1,
                        absl::StrFormat("%g m/s and %g rad/s", velocity, rate),
                        absl::StrFormat("at most %g and %g", kMaxVelocity_mps, kMaxRate_radps));
  }
  result.position_sigma_m = state.position_sigma_m();
  result.velocity_sigma_mps = state.velocity_sigma_mps();
  absl::Status s = CheckDeviation(result.position_sigma_m, Path(field, "position_sigma_m"));
  if (!s.ok()) return s;
  s = CheckDeviation(result.velocity_sigma_mps, Path(field, "velocity_sigma_mps"));
  if (!s.ok()) return s;
  result.first_seen_ns = state.first_seen_ns();
  result.last_seen_ns = state.last_seen_ns();
  result.observations = state.observations();
  return result;
}

}  // namespace clearance::wire
