// Poses, points, boxes and twists: Eigen <-> proto.
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "clearance/v1/common.pb.h"
#include "server/core/aabb.h"
#include "server/core/pose.h"

namespace clearance::wire {

// Quaternions are renormalised where their norm is off by less than this.
inline constexpr double kQuaternionTolerance = 1e-3;

// All errors are INVALID_ARGUMENT naming `field`: values that are not finite, a quaternion that is
// not of unit length, a box with min > max, a negative size.
absl::StatusOr<Pose> PoseFromProto(const v1::Pose& pose, std::string_view field);
absl::StatusOr<Eigen::Vector3d> PointFromProto(const v1::Point& point, std::string_view field);
absl::StatusOr<Aabb> BoxFromProto(const v1::Box& box, std::string_view field);
absl::StatusOr<OrientedBox> BoxFromProto(const v1::OrientedBox& box, std::string_view field);
absl::StatusOr<Twist> TwistFromProto(const v1::Twist& twist, std::string_view field);

void ToProto(const Pose& pose, v1::Pose* out);
void ToProto(const Eigen::Vector3d& point, v1::Point* out);
void ToProto(const Aabb& box, v1::Box* out);
void ToProto(const OrientedBox& box, v1::OrientedBox* out);
void ToProto(const Twist& twist, v1::Twist* out);

// n times tx, ty, tz, qx, qy, qz, qw as f64.
absl::StatusOr<std::vector<Pose>> DecodePoses(std::string_view bytes, std::string_view field);
void AppendPose(const Pose& pose, std::string* bytes);

// n times x, y, z: 3 x n, finite. f32 widens exactly.
absl::StatusOr<Eigen::Matrix3Xf> DecodePoints3f(std::string_view f32, std::string_view field);
absl::StatusOr<Eigen::Matrix3Xd> DecodePoints3d(std::string_view f64, std::string_view field);
std::string EncodePoints(const Eigen::Matrix3Xf& points);
std::string EncodePoints(const Eigen::Matrix3Xd& points);

}  // namespace clearance::wire
