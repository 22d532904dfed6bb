#include <algorithm>
#include <numeric>
#include <vector>

#include "server/query/block_mesher.h"

namespace clearance {
namespace {

// Disjoint sets of vertices.
class Components {
 public:
  explicit Components(size_t count) : parents_(count) {
    std::iota(parents_.begin(), parents_.end(), 0u);
  }
  uint32_t Root(uint32_t v) {
    while (parents_[v] != v) v = parents_[v] = parents_[parents_[v]];
    return v;
  }
  void Join(uint32_t a, uint32_t b) {
    a = Root(a), b = Root(b);
    if (a != b) parents_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<uint32_t> parents_;
};

}  // namespace

void RemoveSmallComponents(uint32_t min_triangles, Mesh* mesh) {
  Components components(mesh->vertices.size());
  for (const auto& triangle : mesh->triangles) {
    components.Join(triangle[0], triangle[1]);
    components.Join(triangle[1], triangle[2]);
  }
  std::vector<uint32_t> size(mesh->vertices.size(), 0);
  for (const auto& triangle : mesh->triangles) ++size[components.Root(triangle[0])];
  const auto kept = [&](uint32_t v) { return size[components.Root(v)] >= min_triangles; };

  Mesh result;
  result.origin_M = mesh->origin_M;
  std::vector<uint32_t> renumbered(mesh->vertices.size());
  for (uint32_t v = 0; v < mesh->vertices.size(); ++v) {
    if (!kept(v)) continue;
    renumbered[v] = static_cast<uint32_t>(result.vertices.size());
    result.vertices.push_back(mesh->vertices[v]);
    result.normals.push_back(mesh->normals[v]);
  }
  for (const auto& triangle : mesh->triangles) {
    if (!kept(triangle[0])) continue;
    result.triangles.push_back(
        {renumbered[triangle[0]], renumbered[triangle[1]], renumbered[triangle[2]]});
  }
  *mesh = std::move(result);
}

}  // namespace clearance
