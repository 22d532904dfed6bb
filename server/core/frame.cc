#include "server/core/frame.h"

#include <cmath>
#include <set>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

// Wider than any map projection's metres, and voxel indices stay within 32 bits.
constexpr double kMaxCoordinate_m = 1e7;

absl::Status CheckRigid(const Pose& T, const std::string& field) {
  if (!T.matrix().allFinite()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s is not finite; expected a rigid pose", field));
  }
  if (T.translation().cwiseAbs().maxCoeff() > kMaxCoordinate_m) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s is at (%g, %g, %g) m; coordinates are limited to %g m", field, T.translation().x(),
        T.translation().y(), T.translation().z(), kMaxCoordinate_m));
  }
  const double off = (T.linear() * T.linear().transpose() - Eigen::Matrix3d::Identity()).norm();
  if (off > 1e-6 || T.linear().determinant() < 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s is not a rigid pose: |R R^T - I| = %.3g, det %.3g; limit 1e-6 and det +1", field, off,
        T.linear().determinant()));
  }
  return absl::OkStatus();
}

absl::Status CheckLabels(const char* field, size_t labels, size_t elements) {
  if (labels == 0 || labels == elements) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s has %d labels for %d elements; expected none or one each", field, labels, elements));
}

absl::Status Check(const PointCloud& cloud, const FrameLimits& limits) {
  const size_t n = cloud.points_X.cols();
  if (n > limits.max_points) {
    return absl::InvalidArgumentError(
        absl::StrFormat("cloud.points has %d points; limit %d", n, limits.max_points));
  }
  if (size_t{cloud.columns} * cloud.rows != n && (cloud.columns != 0 || cloud.rows != 0)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "cloud has %d points but columns x rows = %d x %d; expected equal, or both 0", n,
        cloud.columns, cloud.rows));
  }
  if (auto s = CheckLabels("cloud.labels", cloud.labels.size(), n); !s.ok()) return s;
  if (!cloud.points_X.allFinite()) {
    for (size_t i = 0; i < n; ++i) {
      if (cloud.points_X.col(i).allFinite()) continue;
      return absl::InvalidArgumentError(
          absl::StrFormat("cloud.points[%d] = (%g, %g, %g) is not finite", i, cloud.points_X(0, i),
                          cloud.points_X(1, i), cloud.points_X(2, i)));
    }
  }
  return absl::OkStatus();
}

absl::Status Check(const DepthImage& image, const FrameLimits& limits) {
  const size_t n = size_t{image.width} * image.height;
  if (n == 0 || n > limits.max_points) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "depth is %d x %d pixels; expected 1 to %d", image.width, image.height, limits.max_points));
  }
  if (image.depth.size() != n) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "depth.depth has %d values; expected width x height = %d", image.depth.size(), n));
  }
  if (auto s = CheckLabels("depth.labels", image.labels.size(), n); !s.ok()) return s;
  const auto positive = [](double x) { return std::isfinite(x) && x > 0; };
  if (!positive(image.fx) || !positive(image.fy) || !std::isfinite(image.cx) ||
      !std::isfinite(image.cy)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "depth intrinsics fx %g, fy %g, cx %g, cy %g: focal lengths must be finite and positive",
        image.fx, image.fy, image.cx, image.cy));
  }
  if (!positive(image.depth_scale_m)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "depth.depth_scale_m is %g; must be finite and positive", image.depth_scale_m));
  }
  return absl::OkStatus();
}

absl::Status Check(std::monostate, const FrameLimits&) { return absl::OkStatus(); }

}  // namespace

absl::Status ValidateFrame(const Frame& frame, const FrameLimits& limits) {
  if (auto s = CheckRigid(frame.T_W_X, "world_from_sensor"); !s.ok()) return s;
  if (!std::isfinite(frame.max_range_m) || frame.max_range_m < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("max_range_m is %g; must be finite and >= 0", frame.max_range_m));
  }
  auto status = std::visit([&](const auto& o) { return Check(o, limits); }, frame.observation);
  if (!status.ok()) return status;
  if (frame.motions.size() > limits.max_motions) {
    return absl::InvalidArgumentError(absl::StrFormat("motions has %d entries; limit %d",
                                                      frame.motions.size(), limits.max_motions));
  }
  std::set<ObjectId> seen;
  for (size_t i = 0; i < frame.motions.size(); ++i) {
    const ObjectMotion& m = frame.motions[i];
    if (m.object_id.is_static()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("motions[%d].object_id is 0, the static world; expected 1 to 65535", i));
    }
    if (!seen.insert(m.object_id).second) {
      return absl::InvalidArgumentError(
          absl::StrFormat("motions[%d].object_id %d occurs twice; expected one motion an object", i,
                          m.object_id.value()));
    }
    if (auto s = CheckRigid(m.pose, absl::StrFormat("motions[%d].pose", i)); !s.ok()) return s;
    if (m.covariance && !m.covariance->allFinite()) {
      return absl::InvalidArgumentError(absl::StrFormat("motions[%d].covariance is not finite", i));
    }
  }
  return absl::OkStatus();
}

}  // namespace clearance
