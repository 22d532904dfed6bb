// Alg. 1, first line: a frame's measurements as points, split by label into M^0 and M^j.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "server/core/aabb.h"
#include "server/core/frame.h"
#include "server/integration/object_motion.h"

namespace clearance {

struct LabelSplit {
  // Of a depth image a column is a pixel, row by row; of a cloud, a return within range. Columns
  // that no list names are unspecified.
  Eigen::Matrix3Xf points_X;
  std::vector<uint32_t> static_points;  // columns of points_X, rising
  LabelledPoints object_points;         // likewise

  bool empty() const { return static_points.empty() && object_points.empty(); }
};

// Returns nearer than max_range_m (Euclidean for clouds, along z for depth images) and, where
// bounds are given, inside them in W. Order of the input is kept.
LabelSplit SplitByLabel(const Frame& frame, double max_range_m, const std::optional<Aabb>& bounds);

}  // namespace clearance
