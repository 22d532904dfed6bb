// One labelled observation of the world, as a SLAM front end sends it.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "server/core/object_id.h"
#include "server/core/pose.h"

namespace clearance {

// Points in the sensor frame X, metres, deskewed to the frame's stamp.
// `labels` is empty (all static) or has one id per point. Organised clouds (rows * columns points,
// row by row) mark a missing return by (0, 0, 0); unorganised ones have rows = columns = 0.
struct PointCloud {
  Eigen::Matrix3Xf points_X;
  std::vector<uint16_t> labels;
  uint32_t columns = 0;
  uint32_t rows = 0;
};

// Rectified depth along z (x right, y down, z forward), pixel centres at integers:
// p_X = z * ((u - cx) / fx, (v - cy) / fy, 1), z = depth * depth_scale_m, 0 = no return.
struct DepthImage {
  uint32_t width = 0;
  uint32_t height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double depth_scale_m = 0;
  std::vector<uint16_t> depth;   // row by row
  std::vector<uint16_t> labels;  // empty (all static) or one id per pixel
};

// How an object moved into this frame: the paper's H (world motion from `from_frame_id`, absent =
// the source's previous frame) or its absolute pose.
struct ObjectMotion {
  enum class Kind { kWorldMotion, kWorldFromObject };
  ObjectId object_id;
  Kind kind = Kind::kWorldMotion;
  Pose pose = Pose::Identity();  // H_W or T_W_L
  std::optional<uint64_t> from_frame_id;
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  std::string class_name;
};

struct Frame {
  uint64_t frame_id = 0;
  int64_t stamp_ns = 0;
  std::string source_id;
  Pose T_W_X = Pose::Identity();
  std::variant<std::monostate, PointCloud, DepthImage> observation;
  std::vector<ObjectMotion> motions;
  double max_range_m = 0;  // 0: the map's own limit
};

// A field of the input that is not usable, in the words of api.md: what, where, got and limit.
struct Violation {
  std::string field;
  int64_t index = -1;  // -1: the field as a whole
  std::string description;
};

// Structural limits of one frame; wire conversion and embedded callers check the same things.
// Errors: INVALID_ARGUMENT naming field, index, got and limit, for non-finite points, sizes that do
// not match, intrinsics or depth scale that are not positive, object id 0 in a motion, two motions
// for one object, poses that are not rigid.
struct FrameLimits {
  size_t max_points = 4'000'000;
  size_t max_motions = 4096;
};
absl::Status ValidateFrame(const Frame& frame, const FrameLimits& limits = {});

}  // namespace clearance
