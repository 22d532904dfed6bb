#include "server/map/eviction.h"

#include <algorithm>

#include "server/map/surface_grids.h"

namespace clearance {
namespace {

openvdb::Coord CoordOf(const BlockIndex& b) { return {b.x * 8, b.y * 8, b.z * 8}; }

// Leaves, and tiles of a leaf's size (whole free blocks).
std::vector<BlockIndex> StoredBlocks(const SurfaceGrids& grids) {
  std::vector<BlockIndex> blocks;
  const auto add = [&blocks](const openvdb::Coord& c) {
    blocks.push_back({c.x() >> 3, c.y() >> 3, c.z() >> 3});
  };
  for (auto leaf = grids.weight->tree().cbeginLeaf(); leaf; ++leaf) add(leaf->origin());
  for (auto leaf = grids.evidence->tree().cbeginLeaf(); leaf; ++leaf) add(leaf->origin());
  auto tile = grids.evidence->tree().cbeginValueOn();
  tile.setMaxDepth(openvdb::Int32Tree::DEPTH - 2);
  for (; tile; ++tile) add(tile.getCoord());
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

double DistanceOf(const BlockIndex& block, const Eigen::Vector3d& centre, double voxel_size_m) {
  const double half_m = kBlockSide * voxel_size_m / 2;
  return (BlockOrigin(block, voxel_size_m) + Eigen::Vector3d::Constant(half_m) - centre).norm();
}

}  // namespace

std::optional<double> EvictionRadius(const SurfaceMap& map, const Eigen::Vector3d& centre,
                                     double keep) {
  std::vector<double> distances;
  for (const BlockIndex& block : StoredBlocks(map.grids())) {
    distances.push_back(DistanceOf(block, centre, map.voxel_size_m()));
  }
  if (distances.empty()) return std::nullopt;
  const size_t kept = std::min(distances.size() - 1, static_cast<size_t>(keep * distances.size()));
  std::nth_element(distances.begin(), distances.begin() + kept, distances.end());
  return distances[kept];
}

std::vector<BlockIndex> EvictBeyond(SurfaceMap& map, const Eigen::Vector3d& centre,
                                    double radius_m) {
  const SurfaceGrids& grids = map.grids();
  std::vector<BlockIndex> gone = StoredBlocks(grids);
  std::erase_if(gone, [&](const BlockIndex& block) {
    return DistanceOf(block, centre, map.voxel_size_m()) <= radius_m;
  });
  for (const BlockIndex& block : gone) {
    const openvdb::Coord first = CoordOf(block);
    grids.mean->tree().addTile(1, first, 0.f, false);
    grids.weight->tree().addTile(1, first, 0.f, false);
    grids.evidence->tree().addTile(1, first, 0, false);
  }
  // Nodes without content go, too.
  grids.mean->tree().prune();
  grids.weight->tree().prune();
  return gone;
}

}  // namespace clearance
