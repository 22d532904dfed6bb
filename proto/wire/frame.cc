#include "proto/wire/frame.h"

#include <cmath>
#include <cstring>
#include <utility>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/geometry.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

constexpr size_t kMaxClassNameBytes = 64;

absl::StatusOr<std::vector<uint16_t>> LabelsFromProto(std::string_view bytes, size_t n,
                                                      std::string_view field) {
  auto labels = DecodeArray<uint16_t>(bytes, 1, field);
  if (labels.ok() && !labels->empty() && labels->size() != n) {
    return InvalidField(field, -1, absl::StrCat(labels->size(), " labels"),
                        absl::StrCat(n, " (one each) or none"));
  }
  return labels;
}

absl::Status CheckCount(uint64_t n, const FrameLimits& limits, std::string_view field) {
  if (n <= limits.max_points) return absl::OkStatus();
  return InvalidField(field, -1, absl::StrCat(n, " points"),
                      absl::StrCat("at most ", limits.max_points));
}

absl::StatusOr<PointCloud> CloudFromProto(const v1::PointCloud& in, const FrameLimits& limits,
                                          const std::string& field) {
  const std::string points_field = Path(field, "points_f32");
  const auto n = ElementCount(in.points_f32(), sizeof(float), 3, points_field);
  if (!n.ok()) return n.status();
  if (absl::Status s = CheckCount(*n, limits, points_field); !s.ok()) return s;
  const bool organised = in.columns() != 0 || in.rows() != 0;
  if (organised && uint64_t{in.columns()} * in.rows() != *n) {
    return InvalidField(Path(field, "columns"), -1,
                        absl::StrCat(in.columns(), " columns x ", in.rows(), " rows"),
                        absl::StrCat("a product of ", *n, " (the points), or both 0"));
  }
  PointCloud cloud;
  cloud.columns = in.columns();
  cloud.rows = in.rows();
  auto points = DecodePoints3f(in.points_f32(), points_field);
  if (!points.ok()) return points.status();
  cloud.points_X = *std::move(points);
  auto labels = LabelsFromProto(in.labels_u16(), *n, Path(field, "labels_u16"));
  if (!labels.ok()) return labels.status();
  cloud.labels = *std::move(labels);
  return cloud;
}

absl::Status CheckIntrinsics(const v1::DepthImage& in, const std::string& field) {
  const auto positive = [&](double value, const char* name) {
    if (std::isfinite(value) && value > 0) return absl::OkStatus();
    return InvalidField(Path(field, name), -1, absl::StrCat(value), "a finite number above 0");
  };
  const auto finite = [&](double value, const char* name) {
    if (std::isfinite(value)) return absl::OkStatus();
    return InvalidField(Path(field, name), -1, absl::StrCat(value), "a finite number");
  };
  for (const absl::Status& status :
       {positive(in.fx(), "fx"), positive(in.fy(), "fy"), finite(in.cx(), "cx"),
        finite(in.cy(), "cy"), positive(in.depth_scale_m(), "depth_scale_m")}) {
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::StatusOr<DepthImage> DepthFromProto(const v1::DepthImage& in, const FrameLimits& limits,
                                          const std::string& field) {
  const uint64_t n = uint64_t{in.width()} * in.height();
  if (n == 0) {
    return InvalidField(Path(field, in.width() == 0 ? "width" : "height"), -1, "0", "above 0");
  }
  if (absl::Status s = CheckCount(n, limits, Path(field, "width")); !s.ok()) return s;
  if (absl::Status s = CheckIntrinsics(in, field); !s.ok()) return s;
  DepthImage image;
  image.width = in.width();
  image.height = in.height();
  image.fx = in.fx();
  image.fy = in.fy();
  image.cx = in.cx();
  image.cy = in.cy();
  image.depth_scale_m = in.depth_scale_m();
  if (in.depth_u16().size() != 2 * n) {
    return InvalidField(
        Path(field, "depth_u16"), -1, absl::StrCat(in.depth_u16().size(), " bytes"),
        absl::StrFormat("%d (%d x %d pixels of 2 bytes)", 2 * n, in.width(), in.height()));
  }
  image.depth.resize(n);
  std::memcpy(image.depth.data(), in.depth_u16().data(), 2 * n);
  auto labels = LabelsFromProto(in.labels_u16(), n, Path(field, "labels_u16"));
  if (!labels.ok()) return labels.status();
  image.labels = *std::move(labels);
  return image;
}

absl::Status CovarianceFromProto(const std::string& bytes, const std::string& field,
                                 ObjectMotion& motion) {
  if (bytes.empty()) return absl::OkStatus();
  const auto values = DecodeArray<double>(bytes, 36, field);
  if (!values.ok()) return values.status();
  if (values->size() != 36) {
    return InvalidField(field, -1, absl::StrCat(bytes.size(), " bytes"), "288 (6x6 doubles)");
  }
  using RowMajor = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  const RowMajor covariance = Eigen::Map<const RowMajor>(values->data());
  for (int i = 0; i < 6; ++i) {
    if (covariance(i, i) >= 0) continue;
    return InvalidField(field, i * 7, absl::StrCat("a variance of ", covariance(i, i)),
                        "no negative variance");
  }
  motion.covariance = covariance;
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<ObjectMotion> MotionFromProto(const v1::ObjectMotion& in, std::string_view field) {
  ObjectMotion motion;
  const auto id = ObjectIdFromProto(in.object_id(), Path(field, "object_id"));
  if (!id.ok()) return id.status();
  motion.object_id = *id;
  absl::StatusOr<Pose> pose;
  switch (in.motion_case()) {
    case v1::ObjectMotion::kWorldMotion:
      motion.kind = ObjectMotion::Kind::kWorldMotion;
      pose = PoseFromProto(in.world_motion(), Path(field, "world_motion"));
      break;
    case v1::ObjectMotion::kWorldFromObject:
      motion.kind = ObjectMotion::Kind::kWorldFromObject;
      pose = PoseFromProto(in.world_from_object(), Path(field, "world_from_object"));
      break;
    case v1::ObjectMotion::MOTION_NOT_SET:
      return InvalidField(Path(field, "motion"), -1, "nothing",
                          "world_motion or world_from_object");
  }
  if (!pose.ok()) return pose.status();
  motion.pose = *pose;
  if (in.has_from_frame_id()) motion.from_frame_id = in.from_frame_id();
  if (absl::Status s =
          CovarianceFromProto(in.covariance_f64(), Path(field, "covariance_f64"), motion);
      !s.ok()) {
    return s;
  }
  if (in.class_name().size() > kMaxClassNameBytes) {
    return InvalidField(Path(field, "class_name"), -1,
                        absl::StrCat(in.class_name().size(), " bytes"),
                        absl::StrCat("at most ", kMaxClassNameBytes));
  }
  motion.class_name = in.class_name();
  return motion;
}

absl::StatusOr<double> MaxRangeFromProto(double max_range_m, std::string_view field) {
  if (!std::isfinite(max_range_m) || max_range_m < 0) {
    return InvalidField(field, -1, absl::StrCat(max_range_m), "0 (the map's limit) or more metres");
  }
  return max_range_m;
}

absl::StatusOr<Frame> FrameFromProto(const v1::Frame& in, const FrameLimits& limits,
                                     std::string_view field) {
  Frame frame;
  frame.frame_id = in.frame_id();
  frame.stamp_ns = in.stamp_ns();
  if (!in.submap_id().empty()) {
    return InvalidField(Path(field, "submap_id"), -1, "a value", "empty: it is reserved");
  }
  if (!in.has_world_from_sensor()) {
    return InvalidField(Path(field, "world_from_sensor"), -1, "nothing", "the sensor's pose");
  }
  const auto pose = PoseFromProto(in.world_from_sensor(), Path(field, "world_from_sensor"));
  if (!pose.ok()) return pose.status();
  frame.T_W_X = *pose;
  if (in.has_cloud()) {
    auto cloud = CloudFromProto(in.cloud(), limits, Path(field, "cloud"));
    if (!cloud.ok()) return cloud.status();
    frame.observation = *std::move(cloud);
  } else if (in.has_depth()) {
    auto depth = DepthFromProto(in.depth(), limits, Path(field, "depth"));
    if (!depth.ok()) return depth.status();
    frame.observation = *std::move(depth);
  }
  if (static_cast<size_t>(in.motions_size()) > limits.max_motions) {
    return InvalidField(Path(field, "motions"), -1, absl::StrCat(in.motions_size()),
                        absl::StrCat("at most ", limits.max_motions));
  }
  absl::flat_hash_set<ObjectId> seen;
  for (int i = 0; i < in.motions_size(); ++i) {
    const std::string motion_field = PathAt(field, "motions", i);
    auto motion = MotionFromProto(in.motions(i), motion_field);
    if (!motion.ok()) return motion.status();
    if (!seen.insert(motion->object_id).second) {
      return InvalidField(Path(motion_field, "object_id"), -1,
                          absl::StrCat("object ", motion->object_id.value(), " again"),
                          "one motion for an object");
    }
    frame.motions.push_back(*std::move(motion));
  }
  return frame;
}

void ToProto(const ObjectMotion& motion, v1::ObjectMotion* out) {
  out->set_object_id(motion.object_id.value());
  ToProto(motion.pose, motion.kind == ObjectMotion::Kind::kWorldMotion
                           ? out->mutable_world_motion()
                           : out->mutable_world_from_object());
  if (motion.from_frame_id) out->set_from_frame_id(*motion.from_frame_id);
  if (motion.covariance) {
    const Eigen::Matrix<double, 6, 6, Eigen::RowMajor> covariance = *motion.covariance;
    out->set_covariance_f64(EncodeArray(absl::Span<const double>(covariance.data(), 36)));
  }
  out->set_class_name(motion.class_name);
}

void ToProto(const Frame& frame, v1::Frame* out) {
  out->Clear();
  out->set_frame_id(frame.frame_id);
  out->set_stamp_ns(frame.stamp_ns);
  ToProto(frame.T_W_X, out->mutable_world_from_sensor());
  if (const auto* cloud = std::get_if<PointCloud>(&frame.observation)) {
    v1::PointCloud* c = out->mutable_cloud();
    c->set_points_f32(EncodePoints(cloud->points_X));
    c->set_labels_u16(EncodeArray(cloud->labels));
    c->set_columns(cloud->columns);
    c->set_rows(cloud->rows);
  } else if (const auto* depth = std::get_if<DepthImage>(&frame.observation)) {
    v1::DepthImage* d = out->mutable_depth();
    d->set_width(depth->width);
    d->set_height(depth->height);
    d->set_fx(depth->fx);
    d->set_fy(depth->fy);
    d->set_cx(depth->cx);
    d->set_cy(depth->cy);
    d->set_depth_scale_m(depth->depth_scale_m);
    d->set_depth_u16(EncodeArray(depth->depth));
    d->set_labels_u16(EncodeArray(depth->labels));
  }
  for (const ObjectMotion& motion : frame.motions) ToProto(motion, out->add_motions());
}

void ToProto(const Violation& violation, v1::Violation* out) {
  out->set_field(violation.field);
  out->set_index(violation.index);
  out->set_description(violation.description);
}

}  // namespace clearance::wire
