#include <bit>
#include <cstring>
#include <string>

#include "absl/strings/str_format.h"
#include "server/query/mesh.h"

namespace clearance {
namespace {

static_assert(std::endian::native == std::endian::little);

// Floats resolve 0.06 mm up to here.
constexpr double kFloatReachM = 1000;

template <typename T>
void Append(const T& value, std::string* out) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out->append(bytes, sizeof(T));
}

bool NeedsDouble(const Mesh& mesh) {
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    const Eigen::Vector3d p_M = mesh.origin_M + vertex.cast<double>();
    if (p_M.cwiseAbs().maxCoeff() > kFloatReachM) return true;
  }
  return false;
}

}  // namespace

Mesh Transformed(const Mesh& mesh, const Pose& T_A_M) {
  Mesh result = mesh;
  result.origin_M = T_A_M * mesh.origin_M;
  const Eigen::Matrix3f R_A_M = T_A_M.linear().cast<float>();
  for (Eigen::Vector3f& vertex : result.vertices) vertex = R_A_M * vertex;
  for (Eigen::Vector3f& normal : result.normals) normal = R_A_M * normal;
  return result;
}

std::string WritePly(const Mesh& mesh) {
  const bool doubles = NeedsDouble(mesh);
  const char* type = doubles ? "double" : "float";
  std::string out = absl::StrFormat(
      "ply\nformat binary_little_endian 1.0\nelement vertex %d\n"
      "property %s x\nproperty %s y\nproperty %s z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "element face %d\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices.size(), type, type, type, mesh.triangles.size());
  out.reserve(out.size() + mesh.vertices.size() * 36 + mesh.triangles.size() * 13);
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d p_M = mesh.origin_M + mesh.vertices[i].cast<double>();
    for (int axis = 0; axis < 3; ++axis) {
      if (doubles) {
        Append(p_M[axis], &out);
      } else {
        Append(static_cast<float>(p_M[axis]), &out);
      }
    }
    for (int axis = 0; axis < 3; ++axis) Append(mesh.normals[i][axis], &out);
  }
  for (const auto& triangle : mesh.triangles) {
    Append(uint8_t{3}, &out);
    for (uint32_t v : triangle) Append(static_cast<int32_t>(v), &out);
  }
  return out;
}

}  // namespace clearance
