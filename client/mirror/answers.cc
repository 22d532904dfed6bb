#include "client/mirror/answers.h"

#include <chrono>
#include <utility>

#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/status_details.h"
#include "server/map/screw_twist.h"
#include "server/query/point_query.h"

namespace clearance::client {
namespace {

absl::Status CheckPoints(const Eigen::Matrix3Xd& points_W) {
  if (points_W.cols() == 0) {
    return wire::InvalidField("points_W", -1, "no points", "at least one");
  }
  const absl::Span<const double> values(points_W.data(), static_cast<size_t>(points_W.size()));
  return wire::CheckFinite(values, 3, "points_W");
}

// The pose as it comes from the server: through a quaternion.
Pose OnTheWire(const Pose& pose) {
  v1::Pose message;
  wire::ToProto(pose, &message);
  return wire::PoseFromProto(message, "pose").value_or(pose);
}

ObjectBrief BriefOf(const ObjectView& object, double horizon_s) {
  ObjectBrief brief;
  brief.object_id = object.id.value();
  brief.generation = object.generation;
  brief.class_name = object.class_name;
  brief.life = static_cast<ObjectLife>(object.life_state);
  const Pose T_W_L = horizon_s == 0 ? object.T_W_L : object.PoseAt(horizon_s);
  brief.T_W_L = OnTheWire(T_W_L);
  brief.twist = horizon_s == 0 ? object.twist : TwistOfScrew(object.screw_W, T_W_L);
  return brief;
}

}  // namespace

MapStamp MapStampOf(const MapView& view) {
  const std::chrono::duration<double> age = std::chrono::steady_clock::now() - view.published_at;
  return {view.revision, view.field_revision, view.epoch, view.stamp_ns, age.count()};
}

absl::StatusOr<DistanceAnswers> AnswerDistances(const MapView& view,
                                                const Eigen::Matrix3Xd& points_W, double horizon_s,
                                                const std::vector<float>& horizons_s) {
  if (absl::Status s = CheckPoints(points_W); !s.ok()) return s;
  clearance::QueryOptions options;
  options.horizon_s = horizon_s;
  options.horizons_s = horizons_s;
  options.gradients = true;
  options.objects = true;
  options.now = std::chrono::steady_clock::now();
  if (absl::Status s = ValidateQuery(view, points_W.cols(), options); !s.ok()) return s;
  DistanceBatch batch = QueryDistances(view, points_W, options);
  DistanceAnswers answers;
  answers.stamp = MapStampOf(view);
  answers.reference_ns = view.stamp_ns;
  answers.distances_m = std::move(batch.distances_m);
  answers.states = std::move(batch.states);
  answers.gradients_W = std::move(batch.gradients_W);
  answers.object_ids = std::move(batch.object_ids);
  for (const uint32_t index : batch.object_indices) {
    answers.objects.push_back(BriefOf(view.objects[index], horizon_s));
  }
  return answers;
}

}  // namespace clearance::client
