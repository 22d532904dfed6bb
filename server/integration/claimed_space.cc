#include "server/integration/claimed_space.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "absl/container/flat_hash_map.h"
#include "server/integration/block_table.h"
#include "server/integration/dilation.h"

namespace clearance {
namespace {

// Voxels of a block within one voxel of a static return.
BlockMask NearReturns(const StaticReturns& returns, const BlockIndex& block) {
  std::array<const BlockMask*, 27> around;
  for (int k = 0; k < 27; ++k) {
    const Eigen::Vector3i step = StepAround(k);
    around[k] = &returns.In({block.x + step.x(), block.y + step.y(), block.z + step.z()});
  }
  return Dilated(around);
}

// The static map around one block of an object's voxels: surface that no return of this frame
// keeps.
class Surroundings {
 public:
  Surroundings(const StaticReturns& returns, const SurfaceMap& map)
      : returns_(returns), map_(map) {}

  struct Block {
    BlockIndex index;
    const float* mean = nullptr;
    BlockMask loose{};  // voxels that hold surface, away from any return
    BlockMask near{};   // voxels near a return
    BlockMask released{};
  };
  Block& At(const BlockIndex& index) {
    const auto [it, fresh] = blocks_.try_emplace(index);
    if (!fresh) return *it->second;
    it->second = std::make_unique<Block>();
    Block& block = *it->second;
    block.index = index;
    block.near = NearReturns(returns_, index);
    const float* weight = map_.WeightBlock(index);
    block.mean = map_.MeanBlock(index);
    if (!weight || !block.mean) return block;
    for (int o = 0; o < kBlockVoxels; ++o) {
      block.loose[o >> 6] |= static_cast<uint64_t>(weight[o] != 0) << (o & 63);
    }
    for (size_t w = 0; w < block.loose.size(); ++w) block.loose[w] &= ~block.near[w];
    return block;
  }
  std::vector<ReleasedBlock> Released() const {
    std::vector<ReleasedBlock> out;
    for (const auto& [index, block] : blocks_) {
      if (block->released != BlockMask{}) out.push_back({index, block->released});
    }
    std::sort(out.begin(), out.end(),
              [](const ReleasedBlock& a, const ReleasedBlock& b) { return a.block < b.block; });
    return out;
  }

 private:
  const StaticReturns& returns_;
  const SurfaceMap& map_;
  absl::flat_hash_map<BlockIndex, std::unique_ptr<Block>> blocks_;
};

}  // namespace

std::vector<ReleasedBlock> ReleaseClaimed(const LocalVoxels& object_W, const StaticReturns& returns,
                                          const SurfaceMap& static_map) {
  constexpr int kReach = 2;  // the band on both sides of a bogus surface
  const double h = static_map.voxel_size_m();
  Surroundings surroundings(returns, static_map);
  for (const LocalVoxels::Block& b : object_W.blocks) {
    std::array<Surroundings::Block*, 27> around;
    bool any = false;
    for (int k = 0; k < 27; ++k) {
      const Eigen::Vector3i step = StepAround(k);
      around[k] =
          &surroundings.At({b.block.x + step.x(), b.block.y + step.y(), b.block.z + step.z()});
      any |= around[k]->loose != BlockMask{};
    }
    if (!any) continue;
    const BlockMask& near = around[13]->near;
    for (uint32_t i = b.begin; i < b.end; ++i) {
      if (Test(near, object_W.offset[i])) continue;
      const VoxelIndex own = VoxelAt({0, 0, 0}, object_W.offset[i]);
      const Eigen::Vector3d point = object_W.centroid[i].cast<double>();
      for (int dx = -kReach; dx <= kReach; ++dx) {
        for (int dy = -kReach; dy <= kReach; ++dy) {
          for (int dz = -kReach; dz <= kReach; ++dz) {
            const VoxelIndex v = own + VoxelIndex(dx, dy, dz);
            Surroundings::Block& block =
                *around[((v.x() >> 3) + 1) * 9 + ((v.y() >> 3) + 1) * 3 + (v.z() >> 3) + 1];
            const int o = OffsetOf(v);
            if (!Test(block.loose, o)) continue;
            // The stored surface passes within a voxel of the point when the voxel's distance to it
            // differs from its distance to the point by no more.
            const double to_point = (VoxelCentre(v, h) - point).norm();
            const double to_surface = std::abs(block.mean[o]);
            if (std::abs(to_point - to_surface) <= h) Set(block.released, o);
          }
        }
      }
    }
  }
  return surroundings.Released();
}

}  // namespace clearance
