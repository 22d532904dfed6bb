#include "planner_demo/episode/triangle_set.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <utility>

#include "absl/strings/str_cat.h"

namespace clearance::demo {
namespace {

constexpr size_t kGroup = 24;

Eigen::AlignedBox3d BoxOf(const Triangle& triangle) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& corner : triangle) box.extend(corner);
  return box;
}

double DistanceToSegment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                         const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double length2 = ab.squaredNorm();
  const double t = length2 > 0.0 ? std::clamp((p - a).dot(ab) / length2, 0.0, 1.0) : 0.0;
  return (p - a - t * ab).norm();
}

}  // namespace

double DistanceToTriangle(const Eigen::Vector3d& p, const Triangle& t) {
  const Eigen::Vector3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
  const double area = normal.norm();
  if (area > 0.0) {
    bool inside = true;
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d& a = t[i];
      const Eigen::Vector3d& b = t[(i + 1) % 3];
      inside = inside && (b - a).cross(p - a).dot(normal) >= 0.0;
    }
    if (inside) return std::abs((p - t[0]).dot(normal)) / area;
  }
  return std::min({DistanceToSegment(p, t[0], t[1]), DistanceToSegment(p, t[1], t[2]),
                   DistanceToSegment(p, t[2], t[0])});
}

TriangleSet::TriangleSet(std::vector<Triangle> triangles) : triangles_(std::move(triangles)) {
  for (const Triangle& triangle : triangles_) bounds_.extend(BoxOf(triangle));
  if (!triangles_.empty()) Split(0, triangles_.size());
}

void TriangleSet::Split(size_t begin, size_t end) {
  Eigen::AlignedBox3d box;
  for (size_t i = begin; i < end; ++i) box.extend(BoxOf(triangles_[i]));
  if (end - begin <= kGroup) {
    groups_.push_back({begin, end, box});
    return;
  }
  int axis = 0;
  box.sizes().maxCoeff(&axis);
  const size_t middle = (begin + end) / 2;
  const auto at = [this](size_t i) { return triangles_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(begin), at(middle), at(end), [axis](const Triangle& a, const Triangle& b) {
    return a[0][axis] + a[1][axis] + a[2][axis] < b[0][axis] + b[1][axis] + b[2][axis];
  });
  Split(begin, middle);
  Split(middle, end);
}

double TriangleSet::Distance(const Eigen::Vector3d& point, double most_m) const {
  if (triangles_.empty() || bounds_.exteriorDistance(point) >= most_m) return most_m;
  double nearest_m = most_m;
  for (const Group& group : groups_) {
    if (group.box.exteriorDistance(point) >= nearest_m) continue;
    for (size_t i = group.begin; i < group.end; ++i) {
      nearest_m = std::min(nearest_m, DistanceToTriangle(point, triangles_[i]));
    }
  }
  return nearest_m;
}

absl::StatusOr<std::vector<Triangle>> ReadTriangles(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::NotFoundError(absl::StrCat("cannot read ", path));
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  constexpr char kEnd[] = "end_header\n";
  const size_t end = bytes.find(kEnd);
  size_t vertices = 0, faces = 0, properties = 0;
  std::istringstream header(bytes.substr(0, end == std::string::npos ? 0 : end));
  for (std::string line; std::getline(header, line);) {
    std::istringstream words(line);
    std::string first, second;
    words >> first >> second;
    if (first == "element" && second == "vertex") words >> vertices;
    if (first == "element" && second == "face") words >> faces;
    if (first == "property" && second == "float") ++properties;
  }
  constexpr size_t kVertex = 3 * sizeof(float);
  constexpr size_t kFace = 1 + 3 * sizeof(int32_t);
  const size_t data = end + sizeof(kEnd) - 1;
  if (end == std::string::npos || properties != 3 ||
      bytes.size() != data + vertices * kVertex + faces * kFace) {
    return absl::DataLossError(
        absl::StrCat(path, " is no binary mesh of triangles with float x, y, z and nothing else"));
  }
  std::vector<Triangle> triangles(faces);
  for (size_t i = 0; i < faces; ++i) {
    int32_t corners[3];
    std::memcpy(corners, bytes.data() + data + vertices * kVertex + i * kFace + 1, sizeof(corners));
    for (int k = 0; k < 3; ++k) {
      if (corners[k] < 0 || static_cast<size_t>(corners[k]) >= vertices) {
        return absl::DataLossError(
            absl::StrCat(path, ": face ", i, " names vertex ", corners[k], " of ", vertices));
      }
      float xyz[3];
      std::memcpy(xyz, bytes.data() + data + static_cast<size_t>(corners[k]) * kVertex, kVertex);
      triangles[i][k] = {xyz[0], xyz[1], xyz[2]};
    }
  }
  return triangles;
}

}  // namespace clearance::demo
