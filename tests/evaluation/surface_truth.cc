#include "tests/evaluation/surface_truth.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace clearance::evaluation {
namespace {

using Corners = std::array<Eigen::Vector3d, 3>;  // relative to the cube's centre

bool Separates(const Corners& t, const Eigen::Vector3d& axis, double half) {
  const double a = axis.dot(t[0]), b = axis.dot(t[1]), c = axis.dot(t[2]);
  const double reach = half * axis.cwiseAbs().sum();
  return std::min({a, b, c}) > reach || std::max({a, b, c}) < -reach;
}

// Separating axes of a triangle and a cube around the origin.
bool Meets(const Corners& t, double half) {
  const Corners edges{t[1] - t[0], t[2] - t[1], t[0] - t[2]};
  for (int a = 0; a < 3; ++a) {
    if (Separates(t, Eigen::Vector3d::Unit(a), half)) return false;
    for (const Eigen::Vector3d& edge : edges) {
      if (Separates(t, Eigen::Vector3d::Unit(a).cross(edge), half)) return false;
    }
  }
  return !Separates(t, edges[0].cross(edges[1]), half);
}

double SquaredToSegment(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double length2 = ab.squaredNorm();
  const double s = length2 > 0 ? std::clamp(-a.dot(ab) / length2, 0.0, 1.0) : 0.0;
  return (a + s * ab).squaredNorm();
}

// Distance of the origin to a triangle.
double Distance(const Corners& t) {
  const Eigen::Vector3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
  double best = std::min(
      {SquaredToSegment(t[0], t[1]), SquaredToSegment(t[1], t[2]), SquaredToSegment(t[2], t[0])});
  const double n2 = normal.squaredNorm();
  if (n2 > 0) {
    const Eigen::Vector3d foot = normal * (normal.dot(t[0]) / n2);
    bool inside = true;
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d& a = t[i];
      const Eigen::Vector3d& b = t[(i + 1) % 3];
      inside &= (b - a).cross(foot - a).dot(normal) >= 0;
    }
    if (inside) best = std::min(best, foot.squaredNorm());
  }
  return std::sqrt(best);
}

}  // namespace

void MarkSurface(const testing::TriangleMesh& mesh_W, double h, VoxelBox<uint8_t>& box) {
  for (const Eigen::Vector3i& triangle : mesh_W.triangles) {
    Eigen::AlignedBox3d bounds;
    for (int i = 0; i < 3; ++i) bounds.extend(mesh_W.vertices[triangle[i]]);
    const VoxelIndex low = VoxelOf(bounds.min() - Eigen::Vector3d::Constant(h), h);
    const VoxelIndex high = VoxelOf(bounds.max() + Eigen::Vector3d::Constant(h), h);
    for (int x = low.x(); x <= high.x(); ++x) {
      for (int y = low.y(); y <= high.y(); ++y) {
        for (int z = low.z(); z <= high.z(); ++z) {
          const VoxelIndex v(x, y, z);
          uint8_t* mark = box.Find(v);
          if (!mark || *mark == (kContainsSurface | kNearSurface)) continue;
          const Eigen::Vector3d c = VoxelCentre(v, h);
          const Corners t{mesh_W.vertices[triangle[0]] - c, mesh_W.vertices[triangle[1]] - c,
                          mesh_W.vertices[triangle[2]] - c};
          if (Distance(t) <= h) *mark |= kNearSurface;
          if (Meets(t, 0.5 * h)) *mark |= kContainsSurface | kNearSurface;
        }
      }
    }
  }
}

}  // namespace clearance::evaluation
