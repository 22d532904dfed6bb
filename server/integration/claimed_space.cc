#include "server/integration/claimed_space.h"

#include <algorithm>
#include <map>

#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"

namespace clearance {
namespace {

struct VoxelKey {
  int x, y, z;
  friend bool operator==(const VoxelKey&, const VoxelKey&) = default;
  template <typename H>
  friend H AbslHashValue(H h, const VoxelKey& k) {
    return H::combine(std::move(h), k.x, k.y, k.z);
  }
};

template <typename Fn>
void ForEachVoxel(const LocalVoxels& voxels, const Fn& fn) {
  for (const auto& b : voxels.blocks) {
    for (uint32_t i = b.begin; i < b.end; ++i) fn(b.block, i);
  }
}

bool HasVoxel(const LocalVoxels& voxels, const VoxelIndex& v) {
  const BlockIndex block = BlockOf(v);
  const auto b = std::lower_bound(
      voxels.blocks.begin(), voxels.blocks.end(), block,
      [](const LocalVoxels::Block& lhs, const BlockIndex& rhs) { return lhs.block < rhs; });
  if (b == voxels.blocks.end() || b->block != block) return false;
  return std::binary_search(voxels.offset.begin() + b->begin, voxels.offset.begin() + b->end,
                            static_cast<uint16_t>(OffsetOf(v)));
}

bool NearStaticPoints(const LocalVoxels& static_W, const VoxelIndex& v) {
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        if (HasVoxel(static_W, v + VoxelIndex(dx, dy, dz))) return true;
      }
    }
  }
  return false;
}

}  // namespace

std::vector<ReleasedBlock> ReleaseClaimed(const LocalVoxels& object_W, const LocalVoxels& static_W,
                                          const SurfaceMap& static_map) {
  constexpr int kReach = 2;  // the band on both sides of a bogus surface
  const double h = static_map.voxel_size_m();
  std::map<BlockIndex, BlockMask> released;
  absl::flat_hash_set<VoxelKey> tried;
  ForEachVoxel(object_W, [&](const BlockIndex& block, uint32_t i) {
    const VoxelIndex own = VoxelAt(block, object_W.offset[i]);
    if (NearStaticPoints(static_W, own)) return;
    for (int dx = -kReach; dx <= kReach; ++dx) {
      for (int dy = -kReach; dy <= kReach; ++dy) {
        for (int dz = -kReach; dz <= kReach; ++dz) {
          const VoxelIndex v = own + VoxelIndex(dx, dy, dz);
          const BlockIndex b = BlockOf(v);
          const float* weight = static_map.WeightBlock(b);
          const int o = OffsetOf(v);
          if (!weight || weight[o] == 0) continue;
          // The stored surface passes within a voxel of the point when the voxel's distance to it
          // differs from its distance to the point by no more.
          const double to_point =
              (VoxelCentre(v, h) - BlockOrigin(block, h) - object_W.centroid[i].cast<double>())
                  .norm();
          const double to_surface = std::abs(static_map.MeanBlock(b)[o]);
          if (std::abs(to_point - to_surface) > h) continue;
          if (!tried.insert({v.x(), v.y(), v.z()}).second) continue;
          if (!NearStaticPoints(static_W, v)) Set(released[b], o);
        }
      }
    }
  });
  std::vector<ReleasedBlock> out;
  for (const auto& [block, voxels] : released) out.push_back({block, voxels});
  return out;
}

}  // namespace clearance
