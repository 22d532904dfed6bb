#include "planner_demo/sequence/ply_file.h"

#include <absl/strings/str_cat.h>

#include <bit>
#include <cerrno>
#include <cstring>
#include <fstream>

namespace clearance::sim {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are written as they are");

template <typename T>
void Append(const T& value, std::string& bytes) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(T));
}

absl::Status Write(const std::string& path, const std::string& elements, const std::string& body) {
  std::ofstream out(path, std::ios::binary);
  out << "ply\nformat binary_little_endian 1.0\n" << elements << "end_header\n" << body;
  out.close();
  if (out.good()) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("cannot write ", path, ": ", std::strerror(errno)));
}

std::string VertexElement(size_t count) {
  return absl::StrCat("element vertex ", count,
                      "\nproperty float x\nproperty float y\nproperty float z\n");
}

}  // namespace

absl::Status WriteCloud(const std::string& path, const Eigen::Matrix3Xf& points_X,
                        const std::vector<uint16_t>& labels) {
  if (static_cast<size_t>(points_X.cols()) != labels.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": got ", labels.size(), " labels, expected ", points_X.cols()));
  }
  std::string body;
  body.reserve(14 * labels.size());
  for (size_t i = 0; i < labels.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) Append(points_X(axis, i), body);
    Append(labels[i], body);
  }
  return Write(path, VertexElement(labels.size()) + "property ushort label\n", body);
}

absl::Status WriteMesh(const std::string& path, const TriangleMesh& mesh) {
  std::string body;
  for (const Eigen::Vector3d& vertex : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) Append(static_cast<float>(vertex[axis]), body);
  }
  for (const auto& face : mesh.faces) {
    Append(uint8_t{3}, body);
    for (const int corner : face) Append(static_cast<int32_t>(corner), body);
  }
  return Write(path,
               absl::StrCat(VertexElement(mesh.vertices.size()), "element face ", mesh.faces.size(),
                            "\nproperty list uchar int vertex_indices\n"),
               body);
}

}  // namespace clearance::sim
