#include "client/convert.h"

#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/map_config.h"

namespace clearance::client {
namespace {

// The server's pose; identity where it is unset or unusable, as objects never seen have none.
Pose PoseOr(const v1::Pose& pose) {
  return wire::PoseFromProto(pose, "pose").value_or(Pose::Identity());
}

absl::Status WrongLength(const char* field, size_t got, size_t expected) {
  return absl::DataLossError(absl::StrFormat(
      "the server's reply: %s has %d elements, expected %d; do client and server match?", field,
      got, expected));
}

// An array of n elements of `width` values; empty is fine where it was not `required`.
template <typename T>
absl::Status Take(const std::string& bytes, size_t width, size_t n, bool required,
                  const char* field, std::vector<T>* out) {
  if (bytes.empty() && !required) return absl::OkStatus();
  if (bytes.size() != n * width * sizeof(T)) {
    return WrongLength(field, bytes.size() / (width * sizeof(T)), n);
  }
  out->resize(n * width);
  if (!bytes.empty()) std::memcpy(out->data(), bytes.data(), bytes.size());
  return absl::OkStatus();
}

absl::Status TakeGradients(const std::string& bytes, size_t n, bool required,
                           Eigen::Matrix3Xf* out) {
  std::vector<float> values;
  absl::Status status = Take(bytes, 3, n, required, "gradients_f32", &values);
  *out = Eigen::Map<const Eigen::Matrix3Xf>(values.data(), 3, values.size() / 3);
  return status;
}

absl::Status TakePoses(const std::string& stamps, const std::string& poses, const char* field,
                       std::vector<StampedPose>* out) {
  std::vector<int64_t> stamps_ns;
  const auto T = wire::DecodePoses(poses, field);
  if (!T.ok()) return absl::DataLossError(T.status().message());
  absl::Status status = Take(stamps, 1, T->size(), true, field, &stamps_ns);
  if (!status.ok()) return status;
  for (size_t i = 0; i < T->size(); ++i) out->push_back({stamps_ns[i], (*T)[i]});
  return status;
}

template <typename Request>
void SetTimeAndConsistency(const QueryOptions& options, Request* request) {
  request->set_map(options.map);
  if (options.at_ns) {
    request->set_at_ns(*options.at_ns);
  } else if (options.horizon_s != 0) {
    request->set_horizon_s(options.horizon_s);
  }
  request->set_reference_ns(options.reference_ns);
  SetConsistency(options, request);
}

template <typename Request>
void SetDistanceOptions(const QueryOptions& options, Request* request) {
  request->set_gradients(options.gradients);
  request->set_fusion(options.weighted_fusion ? v1::FUSION_WEIGHTED : v1::FUSION_UNSPECIFIED);
  SetLayers(options, request->mutable_layers());
  request->set_max_distance_m(options.max_distance_m);
  if constexpr (requires { request->set_sigma_margin(0); }) {
    request->set_sigma_margin(options.sigma_margin);
  }
}

}  // namespace

std::string_view NameOf(ObjectLife life) {
  switch (life) {
    case ObjectLife::kTracked:
      return "tracked";
    case ObjectLife::kCoasting:
      return "coasting";
    case ObjectLife::kLost:
      return "lost";
    case ObjectLife::kRetired:
      return "retired";
    case ObjectLife::kUnspecified:
      break;
  }
  return "unspecified";
}

MapStamp FromProto(const v1::MapStamp& stamp) {
  return {stamp.revision(), stamp.field_revision(), stamp.epoch(), stamp.stamp_ns(),
          stamp.staleness_s()};
}

ObjectBrief FromProto(const v1::ObjectBrief& brief) {
  ObjectBrief result;
  result.object_id = brief.object_id();
  result.generation = brief.generation();
  result.class_name = brief.class_name();
  result.life = v1::LifeState_IsValid(brief.life_state())
                    ? static_cast<ObjectLife>(brief.life_state())
                    : ObjectLife::kUnspecified;
  result.T_W_L = PoseOr(brief.world_from_object());
  result.twist = wire::TwistFromProto(brief.twist(), "twist").value_or(Twist{});
  return result;
}

FrameAck FromProto(const v1::FrameAck& ack) {
  FrameAck result;
  result.frame_id = ack.frame_id();
  result.status = v1::IngestStatus_IsValid(ack.status()) ? static_cast<AckStatus>(ack.status())
                                                         : AckStatus::kUnspecified;
  result.stamp = FromProto(ack.stamp());
  for (const auto& v : ack.violations()) {
    result.violations.push_back({v.field(), v.index(), v.description()});
  }
  result.queue_ms = ack.queue_ms();
  result.integrate_ms = ack.integrate_ms();
  return result;
}

absl::StatusOr<DistanceAnswers> FromProto(const v1::QueryPointsResponse& reply, size_t n,
                                          const QueryOptions& options) {
  DistanceAnswers answers;
  answers.stamp = FromProto(reply.stamp());
  answers.reference_ns = reply.reference_ns();
  for (const absl::Status& status :
       {Take(reply.distances_f32(), 1, n, true, "distances_f32", &answers.distances_m),
        Take(reply.states_u8(), 1, n, true, "states_u8", &answers.states),
        TakeGradients(reply.gradients_f32(), n, options.gradients, &answers.gradients_W),
        Take(reply.object_ids_u32(), 1, n, options.objects, "object_ids_u32", &answers.object_ids),
        Take(reply.sigmas_f32(), 1, n, options.sigmas, "sigmas_f32", &answers.sigmas_m),
        Take(reply.unknown_distances_f32(), 1, n, options.unknown_distances,
             "unknown_distances_f32", &answers.unknown_distances_m)}) {
    if (!status.ok()) return status;
  }
  for (const auto& object : reply.objects()) answers.objects.push_back(FromProto(object));
  return answers;
}

absl::StatusOr<ObjectInfo> FromProto(const v1::ObjectInfo& info) {
  ObjectInfo result;
  result.brief = FromProto(info.brief());
  if (info.has_box()) {
    const auto box = wire::BoxFromProto(info.box(), "box");
    if (!box.ok()) return absl::DataLossError(box.status().message());
    result.box = *box;
  }
  result.first_seen_ns = info.first_seen_ns();
  result.last_seen_ns = info.last_seen_ns();
  result.observations = info.observations();
  absl::Status status = TakePoses(info.history_stamps_i64(), info.history_poses_f64(),
                                  "objects.history", &result.history);
  if (!status.ok()) return status;
  return result;
}

absl::StatusOr<Slice> FromProto(const v1::GetSliceResponse& reply) {
  Slice slice;
  slice.stamp = FromProto(reply.stamp());
  slice.reference_ns = reply.reference_ns();
  slice.origin_W = {reply.origin().x_m(), reply.origin().y_m(), reply.origin().z_m()};
  slice.resolution_m = reply.resolution_m();
  slice.columns = reply.columns();
  slice.rows = reply.rows();
  const size_t n = size_t{slice.columns} * slice.rows;
  for (const absl::Status& status :
       {Take(reply.distances_f32(), 1, n, true, "distances_f32", &slice.distances_m),
        Take(reply.states_u8(), 1, n, true, "states_u8", &slice.states),
        Take(reply.object_ids_u32(), 1, n, false, "object_ids_u32", &slice.object_ids),
        TakeGradients(reply.gradients_f32(), n, false, &slice.gradients_W)}) {
    if (!status.ok()) return status;
  }
  for (const auto& object : reply.objects()) {
    auto info = FromProto(object);
    if (!info.ok()) return info.status();
    slice.objects.push_back(*std::move(info));
  }
  return slice;
}

absl::StatusOr<RegionBlock> FromProto(const v1::GetRegionResponse& reply,
                                      const RegionOptions& options) {
  RegionBlock block;
  block.stamp = FromProto(reply.stamp());
  block.reference_ns = reply.reference_ns();
  block.origin_W = {reply.origin().x_m(), reply.origin().y_m(), reply.origin().z_m()};
  block.resolution_m = reply.resolution_m();
  block.size_x = reply.size_x();
  block.size_y = reply.size_y();
  block.size_z = reply.size_z();
  const size_t n = size_t{block.size_x} * block.size_y * block.size_z;
  for (const absl::Status& status :
       {Take(reply.distances_f32(), 1, n, true, "distances_f32", &block.distances_m),
        Take(reply.states_u8(), 1, n, true, "states_u8", &block.states),
        Take(reply.object_ids_u32(), 1, n, options.query.objects, "object_ids_u32",
             &block.object_ids),
        TakeGradients(reply.gradients_f32(), n, options.query.gradients, &block.gradients_W)}) {
    if (!status.ok()) return status;
  }
  return block;
}

absl::StatusOr<MapInfo> FromProto(const v1::MapInfo& info) {
  MapInfo result;
  result.map = info.map();
  auto settings = wire::MapSettingsFromProto(info.config());
  if (!settings.ok()) return absl::DataLossError(settings.status().message());
  result.settings = *std::move(settings);
  result.stamp = FromProto(info.stamp());
  if (info.has_observed_bounds()) {
    const auto bounds = wire::BoxFromProto(info.observed_bounds(), "observed_bounds");
    if (bounds.ok()) result.observed_bounds = *bounds;
  }
  result.memory_bytes = info.memory_bytes();
  result.live_objects = info.live_objects();
  result.known_objects = info.known_objects();
  result.static_voxels = info.static_voxels();
  for (const auto& source : info.sources()) {
    SourceInfo& s = result.sources.emplace_back();
    s.source_id = source.source_id();
    if (source.has_last_frame_id()) s.last_frame_id = source.last_frame_id();
    s.last_stamp_ns = source.last_stamp_ns();
    s.frames_integrated = source.frames_integrated();
    s.frames_dropped = source.frames_dropped();
    s.frames_rejected = source.frames_rejected();
  }
  absl::Status status = TakePoses(info.trajectory_stamps_i64(), info.trajectory_poses_f64(),
                                  "trajectory", &result.sensor_path);
  if (!status.ok()) return status;
  return result;
}

void ToProto(const QueryOptions& options, v1::QueryPointsRequest* request) {
  SetTimeAndConsistency(options, request);
  SetDistanceOptions(options, request);
  request->set_horizons_f32(wire::EncodeArray(options.horizons_s));
  request->set_objects(options.objects);
  request->set_sigmas(options.sigmas);
  request->set_unknown_distances(options.unknown_distances);
}

void ToProto(const QueryOptions& options, v1::ListObjectsRequest* request) {
  SetTimeAndConsistency(options, request);
}

void ToProto(const SliceOptions& options, v1::GetSliceRequest* request) {
  SetTimeAndConsistency(options.query, request);
  SetDistanceOptions(options.query, request);
  request->set_z_m(options.z_m);
  request->set_resolution_m(options.resolution_m);
  if (options.bounds) wire::ToProto(*options.bounds, request->mutable_bounds());
}

void ToProto(const RegionOptions& options, v1::GetRegionRequest* request) {
  SetTimeAndConsistency(options.query, request);
  SetDistanceOptions(options.query, request);
  request->set_objects(options.query.objects);
  request->set_known_only(options.known_only);
  request->set_resolution_m(options.resolution_m);
  wire::ToProto(options.bounds, request->mutable_bounds());
}

}  // namespace clearance::client
