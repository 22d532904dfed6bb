// What the rays of one frame did in each voxel, gathered by block.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "server/integration/stored_surface.h"
#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// One thread's counts. Blocks are relative to a base block near the sensor, so that rays can be
// walked in float far from the origin.
class RayCounts {
 public:
  struct Block {
    std::array<uint8_t, kBlockVoxels> passed{};   // rays that went through, saturating
    std::array<uint8_t, kBlockVoxels> refuted{};  // of them, rays that were behind stored surface
    std::array<uint8_t, kBlockVoxels>
        doubted{};     // and rays that stored surface should have stopped
    BlockMask held{};  // voxels that hold stored surface
    StoredSurface stored;

    void Pass(int offset) { passed[offset] += passed[offset] < 255; }
    void Doubt(int offset) { doubted[offset] += doubted[offset] < 255; }
    void Refute(int offset) { refuted[offset] += refuted[offset] < 255; }
  };

  RayCounts(const SurfaceMap& map, const BlockIndex& base) : map_(&map), base_(base) {}

  // The counts of a block relative to the base; kept until this object goes.
  Block& At(const BlockIndex& relative) {
    if (last_ && relative == last_index_) return *last_;
    last_index_ = relative;
    last_ = Find(relative);
    return *last_;
  }

  // World indices of all blocks that any thread touched, in order.
  static std::vector<BlockIndex> Blocks(const std::vector<const RayCounts*>& threads);
  static int Passed(const std::vector<const RayCounts*>& threads, const VoxelIndex& v);
  static Block Sum(const std::vector<const RayCounts*>& threads, const BlockIndex& block);

 private:
  static constexpr int kCacheBits = 14;
  struct Slot {
    BlockIndex index;
    Block* block = nullptr;
  };
  Block* Find(const BlockIndex& relative);

  const SurfaceMap* map_;
  BlockIndex base_;
  BlockIndex last_index_;
  Block* last_ = nullptr;
  // Direct-mapped in front of the hash: neighbouring rays visit the same few thousand blocks.
  std::vector<Slot> cache_ = std::vector<Slot>(size_t{1} << kCacheBits);
  absl::flat_hash_map<BlockIndex, std::unique_ptr<Block>> blocks_;
};

}  // namespace clearance
