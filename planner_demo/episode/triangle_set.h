// Distances to a mesh.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace clearance::demo {

using Triangle = std::array<Eigen::Vector3d, 3>;

class TriangleSet {
 public:
  explicit TriangleSet(std::vector<Triangle> triangles);

  // Exact distance to the nearest triangle; `most_m` where there is none closer.
  double Distance(const Eigen::Vector3d& point, double most_m) const;
  const Eigen::AlignedBox3d& bounds() const { return bounds_; }

 private:
  struct Group {
    size_t begin, end;
    Eigen::AlignedBox3d box;
  };
  void Split(size_t begin, size_t end);

  std::vector<Triangle> triangles_;
  std::vector<Group> groups_;
  Eigen::AlignedBox3d bounds_;
};

double DistanceToTriangle(const Eigen::Vector3d& point, const Triangle& triangle);

// A binary little-endian PLY with float x, y, z and triangles as the simulator writes them, as
// truth has them. NOT_FOUND, DATA_LOSS naming the file.
absl::StatusOr<std::vector<Triangle>> ReadTriangles(const std::string& path);

}  // namespace clearance::demo
