#include "proto/wire/geometry.h"

#include <cmath>

#include "absl/strings/str_format.h"
#include "proto/wire/array.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

constexpr size_t kPoseValues = 7;

absl::StatusOr<Pose> MakePose(const double (&v)[kPoseValues], std::string_view field,
                              int64_t index) {
  for (const double value : v) {
    if (std::isfinite(value)) continue;
    return InvalidField(field, index,
                        absl::StrFormat("translation (%g, %g, %g), quaternion (%g, %g, %g, %g)",
                                        v[0], v[1], v[2], v[3], v[4], v[5], v[6]),
                        "finite numbers");
  }
  const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
  const double norm = q.norm();
  if (!(std::abs(norm - 1.0) < kQuaternionTolerance)) {
    return InvalidField(field, index, absl::StrFormat("a quaternion of norm %.6g", norm),
                        "a unit quaternion (qx, qy, qz, qw), norm within 0.001 of 1");
  }
  Pose pose = Pose::Identity();
  pose.linear() = q.normalized().toRotationMatrix();
  pose.translation() = Eigen::Vector3d(v[0], v[1], v[2]);
  return pose;
}

void PoseValues(const Pose& pose, double (&v)[kPoseValues]) {
  Eigen::Quaterniond q(pose.linear());
  q.normalize();
  if (q.w() < 0)
    q.coeffs() = -q.coeffs();  // one of the two signs, so that equal poses encode alike
  for (int i = 0; i < 3; ++i) v[i] = pose.translation()[i];
  v[3] = q.x(), v[4] = q.y(), v[5] = q.z(), v[6] = q.w();
}

template <typename Points>
absl::StatusOr<Points> DecodePoints(std::string_view bytes, std::string_view field) {
  using Scalar = typename Points::Scalar;
  const absl::StatusOr<size_t> n = ElementCount(bytes, sizeof(Scalar), 3, field);
  if (!n.ok()) return n.status();
  Points points(3, *n);
  if (*n > 0) std::memcpy(points.data(), bytes.data(), bytes.size());
  const absl::Span<const Scalar> values(points.data(), *n * 3);
  if (absl::Status s = CheckFinite(values, 3, field); !s.ok()) return s;
  return points;
}

}  // namespace

absl::StatusOr<Pose> PoseFromProto(const v1::Pose& p, std::string_view field) {
  return MakePose({p.tx_m(), p.ty_m(), p.tz_m(), p.qx(), p.qy(), p.qz(), p.qw()}, field, -1);
}

absl::StatusOr<Eigen::Vector3d> PointFromProto(const v1::Point& point, std::string_view field) {
  const Eigen::Vector3d p(point.x_m(), point.y_m(), point.z_m());
  if (!p.allFinite()) {
    return InvalidField(field, -1, absl::StrFormat("(%g, %g, %g)", p.x(), p.y(), p.z()),
                        "finite numbers");
  }
  return p;
}

absl::StatusOr<Aabb> BoxFromProto(const v1::Box& box, std::string_view field) {
  const auto min = PointFromProto(box.min(), Path(field, "min"));
  if (!min.ok()) return min.status();
  const auto max = PointFromProto(box.max(), Path(field, "max"));
  if (!max.ok()) return max.status();
  if ((min->array() > max->array()).any()) {
    return InvalidField(field, -1,
                        absl::StrFormat("min (%g, %g, %g), max (%g, %g, %g)", min->x(), min->y(),
                                        min->z(), max->x(), max->y(), max->z()),
                        "min <= max in every axis");
  }
  return Aabb(*min, *max);
}

absl::StatusOr<OrientedBox> BoxFromProto(const v1::OrientedBox& box, std::string_view field) {
  const auto pose = PoseFromProto(box.world_from_box(), Path(field, "world_from_box"));
  if (!pose.ok()) return pose.status();
  const auto size = PointFromProto(box.size(), Path(field, "size"));
  if (!size.ok()) return size.status();
  if ((size->array() < 0).any()) {
    return InvalidField(Path(field, "size"), -1,
                        absl::StrFormat("(%g, %g, %g)", size->x(), size->y(), size->z()),
                        "no negative side");
  }
  return OrientedBox{*pose, *size};
}

absl::StatusOr<Twist> TwistFromProto(const v1::Twist& twist, std::string_view field) {
  Twist t;
  t.linear_mps = {twist.vx_mps(), twist.vy_mps(), twist.vz_mps()};
  t.angular_radps = {twist.wx_radps(), twist.wy_radps(), twist.wz_radps()};
  if (!t.linear_mps.allFinite() || !t.angular_radps.allFinite()) {
    return InvalidField(field, -1, "a velocity that is not finite", "finite numbers");
  }
  return t;
}

void ToProto(const Pose& pose, v1::Pose* out) {
  double v[kPoseValues];
  PoseValues(pose, v);
  out->set_tx_m(v[0]);
  out->set_ty_m(v[1]);
  out->set_tz_m(v[2]);
  out->set_qx(v[3]);
  out->set_qy(v[4]);
  out->set_qz(v[5]);
  out->set_qw(v[6]);
}

void ToProto(const Eigen::Vector3d& point, v1::Point* out) {
  out->set_x_m(point.x());
  out->set_y_m(point.y());
  out->set_z_m(point.z());
}

void ToProto(const Aabb& box, v1::Box* out) {
  ToProto(Eigen::Vector3d(box.min()), out->mutable_min());
  ToProto(Eigen::Vector3d(box.max()), out->mutable_max());
}

void ToProto(const OrientedBox& box, v1::OrientedBox* out) {
  ToProto(box.world_from_box, out->mutable_world_from_box());
  ToProto(box.size_m, out->mutable_size());
}

void ToProto(const Twist& twist, v1::Twist* out) {
  out->set_vx_mps(twist.linear_mps.x());
  out->set_vy_mps(twist.linear_mps.y());
  out->set_vz_mps(twist.linear_mps.z());
  out->set_wx_radps(twist.angular_radps.x());
  out->set_wy_radps(twist.angular_radps.y());
  out->set_wz_radps(twist.angular_radps.z());
}

absl::StatusOr<std::vector<Pose>> DecodePoses(std::string_view bytes, std::string_view field) {
  const absl::StatusOr<size_t> n = ElementCount(bytes, sizeof(double), kPoseValues, field);
  if (!n.ok()) return n.status();
  std::vector<Pose> poses;
  poses.reserve(*n);
  for (size_t i = 0; i < *n; ++i) {
    double v[kPoseValues];
    std::memcpy(v, bytes.data() + i * sizeof(v), sizeof(v));
    absl::StatusOr<Pose> pose = MakePose(v, field, static_cast<int64_t>(i));
    if (!pose.ok()) return pose.status();
    poses.push_back(*pose);
  }
  return poses;
}

void AppendPose(const Pose& pose, std::string* bytes) {
  double v[kPoseValues];
  PoseValues(pose, v);
  bytes->append(reinterpret_cast<const char*>(v), sizeof(v));
}

absl::StatusOr<Eigen::Matrix3Xf> DecodePoints3f(std::string_view f32, std::string_view field) {
  return DecodePoints<Eigen::Matrix3Xf>(f32, field);
}

absl::StatusOr<Eigen::Matrix3Xd> DecodePoints3d(std::string_view f64, std::string_view field) {
  return DecodePoints<Eigen::Matrix3Xd>(f64, field);
}

std::string EncodePoints(const Eigen::Matrix3Xf& points) {
  return EncodeArray(absl::Span<const float>(points.data(), points.size()));
}

std::string EncodePoints(const Eigen::Matrix3Xd& points) {
  return EncodeArray(absl::Span<const double>(points.data(), points.size()));
}

}  // namespace clearance::wire
