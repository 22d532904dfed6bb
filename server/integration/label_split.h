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
  Eigen::Matrix3Xf points_X;            // every return within range
  std::vector<uint32_t> static_points;  // columns of points_X
  LabelledPoints object_points;
};

// Returns nearer than max_range_m (Euclidean for clouds, along z for depth images) and, where
// bounds are given, inside them in W. Order of the input is kept.
LabelSplit SplitByLabel(const Frame& frame, double max_range_m, const std::optional<Aabb>& bounds);

}  // namespace clearance
