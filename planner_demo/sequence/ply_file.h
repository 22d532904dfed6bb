#pragma once

#include <absl/status/status.h>

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "planner_demo/sim/mesh.h"

namespace clearance::sim {

// Binary little-endian PLY files, as a sequence folder holds them.
absl::Status WriteCloud(const std::string& path, const Eigen::Matrix3Xf& points_X,
                        const std::vector<uint16_t>& labels);
absl::Status WriteMesh(const std::string& path, const TriangleMesh& mesh);

}  // namespace clearance::sim
