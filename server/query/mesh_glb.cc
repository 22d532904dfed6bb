#include <Eigen/Geometry>
#include <bit>
#include <cstring>
#include <string>

#include "absl/strings/str_format.h"
#include "server/query/mesh.h"

namespace clearance {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr uint32_t kMagic = 0x46546C67;  // "glTF"
constexpr uint32_t kJsonChunk = 0x4E4F534A;
constexpr uint32_t kBinaryChunk = 0x004E4942;

void AppendWord(uint32_t value, std::string* out) {
  char bytes[4];
  std::memcpy(bytes, &value, 4);
  out->append(bytes, 4);
}

void AppendChunk(uint32_t type, std::string data, char padding, std::string* out) {
  while (data.size() % 4 != 0) data.push_back(padding);
  AppendWord(static_cast<uint32_t>(data.size()), out);
  AppendWord(type, out);
  out->append(data);
}

// Node 0 turns z up into y up: (x, y, z) -> (x, z, -y), a quarter turn about x; node 1 shifts in M.
std::string Describe(const Mesh& mesh, size_t vertex_bytes, size_t index_bytes) {
  if (mesh.triangles.empty()) {
    return R"({"asset":{"version":"2.0","generator":"clearance"},"scene":0,"scenes":[{}]})";
  }
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& vertex : mesh.vertices) box.extend(vertex);
  return absl::StrFormat(
      R"({"asset":{"version":"2.0","generator":"clearance"},"scene":0,"scenes":[{"nodes":[0]}],)"
      R"("nodes":[{"name":"z_up","rotation":[-0.7071067811865476,0,0,0.7071067811865476],)"
      R"("children":[1]},{"mesh":0,"translation":[%.17g,%.17g,%.17g]}],)"
      R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1},"indices":2,)"
      R"("material":0}]}],"materials":[{"doubleSided":true,"pbrMetallicRoughness":)"
      R"({"baseColorFactor":[0.7,0.7,0.72,1],"metallicFactor":0,"roughnessFactor":0.9}}],)"
      R"("accessors":[{"bufferView":0,"componentType":5126,"count":%d,"type":"VEC3",)"
      R"("min":[%.9g,%.9g,%.9g],"max":[%.9g,%.9g,%.9g]},)"
      R"({"bufferView":1,"componentType":5126,"count":%d,"type":"VEC3"},)"
      R"({"bufferView":2,"componentType":5125,"count":%d,"type":"SCALAR"}],)"
      R"("bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":%d,"target":34962},)"
      R"({"buffer":0,"byteOffset":%d,"byteLength":%d,"target":34962},)"
      R"({"buffer":0,"byteOffset":%d,"byteLength":%d,"target":34963}],)"
      R"("buffers":[{"byteLength":%d}]})",
      mesh.origin_M.x(), mesh.origin_M.y(), mesh.origin_M.z(), mesh.vertices.size(), box.min().x(),
      box.min().y(), box.min().z(), box.max().x(), box.max().y(), box.max().z(),
      mesh.vertices.size(), 3 * mesh.triangles.size(), vertex_bytes, vertex_bytes, vertex_bytes,
      2 * vertex_bytes, index_bytes, 2 * vertex_bytes + index_bytes);
}

}  // namespace

std::string WriteGlb(const Mesh& mesh) {
  const size_t vertex_bytes = mesh.vertices.size() * sizeof(Eigen::Vector3f);
  const size_t index_bytes = mesh.triangles.size() * sizeof(mesh.triangles[0]);
  std::string chunks;
  AppendChunk(kJsonChunk, Describe(mesh, vertex_bytes, index_bytes), ' ', &chunks);
  if (!mesh.triangles.empty()) {
    std::string binary(2 * vertex_bytes + index_bytes, '\0');
    std::memcpy(binary.data(), mesh.vertices.data(), vertex_bytes);
    std::memcpy(binary.data() + vertex_bytes, mesh.normals.data(), vertex_bytes);
    std::memcpy(binary.data() + 2 * vertex_bytes, mesh.triangles.data(), index_bytes);
    AppendChunk(kBinaryChunk, std::move(binary), '\0', &chunks);
  }
  std::string out;
  AppendWord(kMagic, &out);
  AppendWord(2, &out);
  AppendWord(static_cast<uint32_t>(12 + chunks.size()), &out);
  return out + chunks;
}

}  // namespace clearance
