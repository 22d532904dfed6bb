#include "server/service/query_replies.h"

#include <algorithm>
#include <utility>

#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "server/map/screw_twist.h"
#include "server/query/point_query.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

constexpr size_t kHistoryBytesPerPose = 64;
constexpr size_t kMaxHistoryBytes = 3u << 20;

void AppendHistory(const ObjectView& object, size_t max_poses, v1::ObjectInfo* out) {
  if (!object.history) return;
  const std::vector<PoseStamp>& history = *object.history;
  const size_t count = std::min(history.size(), max_poses);
  std::vector<int64_t> stamps;
  stamps.reserve(count);
  out->mutable_history_poses_f64()->reserve(count * 7 * sizeof(double));
  for (size_t i = history.size() - count; i < history.size(); ++i) {
    stamps.push_back(history[i].stamp_ns);
    wire::AppendPose(history[i].pose, out->mutable_history_poses_f64());
  }
  out->set_history_stamps_i64(wire::EncodeArray(stamps));
}

}  // namespace

void ToProto(const ObjectView& object, double horizon_s, v1::ObjectBrief* out) {
  out->set_object_id(object.id.value());
  out->set_generation(object.generation);
  out->set_class_name(object.class_name);
  out->set_life_state(static_cast<v1::LifeState>(object.life_state));
  const Pose T_W_L = horizon_s == 0 ? object.T_W_L : object.PoseAt(horizon_s);
  wire::ToProto(T_W_L, out->mutable_world_from_object());
  wire::ToProto(horizon_s == 0 ? object.twist : TwistOfScrew(object.screw_W, T_W_L),
                out->mutable_twist());
}

void ToProto(const ObjectView& object, double horizon_s, v1::ObjectInfo* out) {
  ToProto(object, horizon_s, out->mutable_brief());
  ObjectView later = object;
  if (horizon_s != 0) later.T_W_L = object.PoseAt(horizon_s);
  wire::ToProto(later.Box(), out->mutable_box());
  out->set_first_seen_ns(object.first_seen_ns);
  out->set_last_seen_ns(object.last_seen_ns);
  out->set_observations(object.observations);
  out->set_source_id(object.source_id);
  if (object.shape) out->set_voxel_count(object.shape->sites.size());
}

absl::StatusOr<v1::QueryPointsResponse> AnswerPoints(const MapView& view,
                                                     const wire::PointsQuery& query) {
  wire::QuerySettings settings = query.settings;
  absl::StatusOr<QueryOptions> options = ResolveOptions(view, settings);
  if (!options.ok()) return options.status();
  options->gradients = query.gradients;
  options->objects = query.objects;
  options->sigmas = query.sigmas;
  options->unknown_distances = query.unknown_distances;
  if (!query.horizons_s.empty()) {
    absl::StatusOr<std::vector<float>> horizons =
        ResolveHorizons(view, settings.time, query.horizons_s);
    if (!horizons.ok()) return horizons.status();
    options->horizons_s = *std::move(horizons);
  }
  if (absl::Status s = ValidateQuery(view, query.points_W.cols(), *options); !s.ok()) return s;
  const DistanceBatch batch = QueryDistances(view, query.points_W, *options);

  v1::QueryPointsResponse response;
  ToProto(StampOf(view), response.mutable_stamp());
  response.set_reference_ns(ReferenceNs(view, settings.time));
  response.set_distances_f32(wire::EncodeArray(batch.distances_m));
  response.set_states_u8(wire::EncodeArray(batch.states));
  if (query.gradients) response.set_gradients_f32(wire::EncodePoints(batch.gradients_W));
  if (query.sigmas) response.set_sigmas_f32(wire::EncodeArray(batch.sigmas_m));
  if (query.unknown_distances) {
    response.set_unknown_distances_f32(wire::EncodeArray(batch.unknown_distances_m));
  }
  if (query.objects) {
    response.set_object_ids_u32(wire::EncodeArray(batch.object_ids));
    for (const uint32_t index : batch.object_indices) {
      ToProto(view.objects[index], options->horizon_s, response.add_objects());
    }
  }
  return response;
}

absl::StatusOr<v1::ListObjectsResponse> AnswerObjects(const MapView& view,
                                                      const wire::ObjectsQuery& query) {
  const absl::StatusOr<double> horizon_s = ResolveHorizon(view, query.settings.time);
  if (!horizon_s.ok()) return horizon_s.status();
  v1::ListObjectsResponse response;
  ToProto(StampOf(view), response.mutable_stamp());
  response.set_reference_ns(ReferenceNs(view, query.settings.time));
  const size_t max_poses =
      kMaxHistoryBytes / kHistoryBytesPerPose / std::max<size_t>(1, view.objects.size());
  for (const ObjectView& object : view.objects) {
    v1::ObjectInfo* info = response.add_objects();
    ToProto(object, *horizon_s, info);
    if (query.include_history) AppendHistory(object, max_poses, info);
  }
  return response;
}

}  // namespace clearance
