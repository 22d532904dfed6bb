// The zero crossing of a surface map as a mesh, kept up to date block by block.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "absl/container/btree_set.h"
#include "absl/types/span.h"
#include "server/map/surface_map.h"
#include "server/map/voxel.h"
#include "server/query/mesh.h"

namespace clearance {

struct MesherOptions {
  float min_weight = 0.3f;  // of all eight voxels of a cell
  // Neighbouring distances that differ by more than this are no one surface's: the cell is left
  // out.
  float max_jump_voxels = 1.5f;
  // Connected components with fewer triangles are left out; 0 = keep all.
  uint32_t min_component_triangles = 0;
};

// Marching cubes over the cells between voxel centres, with one vertex for each cut cell edge,
// shared by all its triangles. Not thread-safe.
class BlockMesher {
 public:
  explicit BlockMesher(const MesherOptions& options = {}) : options_(options) {}

  // Blocks whose mean or weight changed since the last Extract.
  void MarkChanged(absl::Span<const BlockIndex> blocks);
  // Everything changed (also: before the first Extract of a map that is not empty).
  void MarkAll(const SurfaceMap& map);

  // The whole mesh, in the map's frame M. Only cells of marked blocks, and those that touch them,
  // are computed anew; the result is the same as from scratch, in a fixed order.
  Mesh Extract(const SurfaceMap& map);

 private:
  // A cut edge: its lower voxel's block, and 3 * offset in the block + axis.
  struct EdgeRef {
    BlockIndex block;
    uint16_t edge;
  };
  // The cells whose lowest voxel is in one block, and the cut edges whose lower voxel is.
  struct Patch {
    std::vector<uint16_t> edges;            // sorted
    std::vector<Eigen::Vector3f> vertices;  // one an edge, metres from the block's lower corner
    std::vector<std::array<EdgeRef, 3>> triangles;
  };

  Patch MeshBlock(const SurfaceMap& map, const BlockIndex& block) const;
  Mesh Assemble(double voxel_size_m) const;

  MesherOptions options_;
  absl::btree_set<BlockIndex> changed_;
  std::map<BlockIndex, Patch> patches_;
};

// Removes connected components of fewer than `min_triangles` triangles and the vertices only they
// use.
void RemoveSmallComponents(uint32_t min_triangles, Mesh* mesh);

}  // namespace clearance
