#include "server/query/block_mesher.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "absl/container/flat_hash_map.h"
#include "server/query/cube_cases.h"

namespace clearance {
namespace {

// A block's voxels with those beyond its upper faces: 9^3 corners of 8^3 cells.
struct Corners {
  float mean[kHaloVoxels];
  float weight[kHaloVoxels];

  int At(int x, int y, int z) const { return HaloOffset(x, y, z); }
};

// Whether the cell at (x, y, z) may hold surface: all corners known, no jump along its edges.
bool IsUsable(const Corners& corners, int x, int y, int z, float min_weight, float max_jump_m,
              uint8_t* negative) {
  float value[8];
  *negative = 0;
  for (int k = 0; k < 8; ++k) {
    const int at = corners.At(x + (k >> 2), y + ((k >> 1) & 1), z + (k & 1));
    if (!(corners.weight[at] >= min_weight)) return false;
    value[k] = corners.mean[at];
    if (value[k] < 0) *negative |= static_cast<uint8_t>(1 << k);
  }
  if (*negative == 0 || *negative == 0xff) return false;
  for (const CubeEdge& edge : kCubeEdges) {
    if (!(std::abs(value[edge.first] - value[edge.second]) <= max_jump_m)) return false;
  }
  return true;
}

}  // namespace

void BlockMesher::MarkChanged(absl::Span<const BlockIndex> blocks) {
  // A voxel is a corner of the cells of its own block and of the lower neighbours.
  for (const BlockIndex& block : blocks) {
    for (int k = 0; k < 8; ++k) {
      changed_.insert({block.x - (k >> 2), block.y - ((k >> 1) & 1), block.z - (k & 1)});
    }
  }
}

void BlockMesher::MarkAll(const SurfaceMap& map) {
  for (const auto& [block, patch] : patches_) changed_.insert(block);
  MarkChanged(map.BandBlocks());
}

BlockMesher::Patch BlockMesher::MeshBlock(const SurfaceMap& map, const BlockIndex& block) const {
  Corners corners;
  map.ReadBand(block, corners.mean, corners.weight);
  const float voxel_size_m = static_cast<float>(map.voxel_size_m());
  Patch patch;
  for (int offset = 0; offset < kBlockVoxels; ++offset) {
    const int x = offset >> 6, y = (offset >> 3) & 7, z = offset & 7;
    uint8_t negative;
    if (!IsUsable(corners, x, y, z, options_.min_weight, options_.max_jump_voxels * voxel_size_m,
                  &negative)) {
      continue;
    }
    const CubeCase& cube = CaseOf(negative);
    for (int t = 0; t < cube.count; ++t) {
      std::array<EdgeRef, 3> triangle;
      for (int i = 0; i < 3; ++i) {
        const CubeEdge& edge = kCubeEdges[cube.triangles[t][i]];
        const VoxelIndex low = VoxelAt(block, offset) +
                               VoxelIndex(edge.first >> 2, (edge.first >> 1) & 1, edge.first & 1);
        triangle[i] = {BlockOf(low), static_cast<uint16_t>(3 * OffsetOf(low) + edge.axis)};
      }
      patch.triangles.push_back(triangle);
    }
  }
  // Where its edges are cut; whether a cell uses them is known when all patches are.
  for (int offset = 0; offset < kBlockVoxels; ++offset) {
    const int low[3] = {offset >> 6, (offset >> 3) & 7, offset & 7};
    const int at = corners.At(low[0], low[1], low[2]);
    if (!(corners.weight[at] >= options_.min_weight)) continue;
    for (int axis = 0; axis < 3; ++axis) {
      const int next = corners.At(low[0] + (axis == 0), low[1] + (axis == 1), low[2] + (axis == 2));
      const float a = corners.mean[at], b = corners.mean[next];
      if (!(corners.weight[next] >= options_.min_weight) || (a < 0) == (b < 0)) continue;
      Eigen::Vector3f vertex(low[0], low[1], low[2]);
      vertex[axis] += a / (a - b);
      patch.edges.push_back(static_cast<uint16_t>(3 * offset + axis));
      patch.vertices.push_back((vertex.array() + 0.5f) * voxel_size_m);
    }
  }
  return patch;
}

Mesh BlockMesher::Extract(const SurfaceMap& map) {
  const std::vector<BlockIndex> changed(changed_.begin(), changed_.end());
  changed_.clear();
  std::vector<Patch> patches(changed.size());
  tbb::parallel_for(size_t{0}, changed.size(),
                    [&](size_t i) { patches[i] = MeshBlock(map, changed[i]); });
  for (size_t i = 0; i < changed.size(); ++i) {
    if (patches[i].triangles.empty() && patches[i].edges.empty()) {
      patches_.erase(changed[i]);
    } else {
      patches_[changed[i]] = std::move(patches[i]);
    }
  }
  Mesh mesh = Assemble(map.voxel_size_m());
  if (options_.min_component_triangles > 0) {
    RemoveSmallComponents(options_.min_component_triangles, &mesh);
  }
  return mesh;
}

Mesh BlockMesher::Assemble(double voxel_size_m) const {
  constexpr uint32_t kUnused = ~0u;
  Mesh mesh;
  if (patches_.empty()) return mesh;
  mesh.origin_M = BlockOrigin(patches_.begin()->first, voxel_size_m);
  // Vertices are numbered in the order of the blocks and edges, used ones only.
  absl::flat_hash_map<BlockIndex, std::vector<uint32_t>> numbers;
  for (const auto& [block, patch] : patches_) {
    numbers.emplace(block, std::vector<uint32_t>(patch.edges.size(), kUnused));
  }
  const auto number_of = [&](const EdgeRef& ref) -> uint32_t& {
    const std::vector<uint16_t>& edges = patches_.at(ref.block).edges;
    const auto it = std::lower_bound(edges.begin(), edges.end(), ref.edge);
    return numbers.at(ref.block)[it - edges.begin()];
  };
  for (const auto& [block, patch] : patches_) {
    for (const auto& triangle : patch.triangles) {
      for (const EdgeRef& ref : triangle) number_of(ref) = 0;
    }
  }
  for (const auto& [block, patch] : patches_) {
    const Eigen::Vector3f shift = (BlockOrigin(block, voxel_size_m) - mesh.origin_M).cast<float>();
    std::vector<uint32_t>& of_block = numbers.at(block);
    for (size_t i = 0; i < of_block.size(); ++i) {
      if (of_block[i] == kUnused) continue;
      of_block[i] = static_cast<uint32_t>(mesh.vertices.size());
      mesh.vertices.push_back(shift + patch.vertices[i]);
    }
  }
  mesh.normals.assign(mesh.vertices.size(), Eigen::Vector3f::Zero());
  for (const auto& [block, patch] : patches_) {
    for (const auto& refs : patch.triangles) {
      const std::array<uint32_t, 3> triangle = {number_of(refs[0]), number_of(refs[1]),
                                                number_of(refs[2])};
      mesh.triangles.push_back(triangle);
      const Eigen::Vector3f& a = mesh.vertices[triangle[0]];
      const Eigen::Vector3f area_normal =
          (mesh.vertices[triangle[1]] - a).cross(mesh.vertices[triangle[2]] - a);
      for (uint32_t v : triangle) mesh.normals[v] += area_normal;
    }
  }
  for (Eigen::Vector3f& normal : mesh.normals) {
    const float norm = normal.norm();
    normal = norm > 0 ? Eigen::Vector3f(normal / norm) : Eigen::Vector3f::UnitZ();
  }
  return mesh;
}

}  // namespace clearance
