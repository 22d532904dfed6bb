// The closest-site distance field as queries read it: immutable 8^3 blocks shared by pointer.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "server/map/voxel.h"

namespace clearance {

enum class VoxelState : uint8_t { kUnknown = 0, kFree = 1, kOccupied = 2 };

// 8 bytes: the vector from the voxel's centre to its closest surface site in 1/256 voxel, and
// attributes of the voxel (state, confidence, sign) and of the site (normal, sigma).
struct FieldVoxel {
  static constexpr int16_t kNoSite = INT16_MIN;
  static constexpr float kUnit = 1.f / 256.f;  // voxels

  int16_t dx = kNoSite, dy = 0, dz = 0;
  uint16_t attributes = 0;

  // bits 0-1 state; 2 low confidence; 3 negative (the voxel's centre is inside);
  // 4-8 site sigma code; 9-15 site normal code.
  bool has_site() const { return dx != kNoSite; }
  VoxelState state() const { return static_cast<VoxelState>(attributes & 3); }
  bool low_confidence() const { return attributes & 4; }
  bool negative() const { return attributes & 8; }
  int sigma_code() const { return (attributes >> 4) & 31; }
  int normal_code() const { return attributes >> 9; }
  Eigen::Vector3f to_site_voxels() const {
    return Eigen::Vector3f(dx, dy, dz) * kUnit;
  }

  friend bool operator==(const FieldVoxel&, const FieldVoxel&) = default;
};
static_assert(sizeof(FieldVoxel) == 8);

// Unit normal (outwards, towards free space) of a code 0..127 and back. sigma code in voxels:
// logarithmic, code 0 = 1/64 voxel, 31 = 2 voxels or more.
Eigen::Vector3f NormalOfCode(int code);
int CodeOfNormal(const Eigen::Vector3f& unit_normal);
float SigmaVoxelsOfCode(int code);
int CodeOfSigmaVoxels(float sigma_voxels);

struct alignas(64) FieldBlock {
  std::array<FieldVoxel, kBlockVoxels> voxels;
};

// A persistent two-level table: 8^3 blocks to a region (64 voxels a side). Copying the table copies
// region pointers only; a writer replaces the regions it touches. Values are immutable once shared.
class DistanceField {
 public:
  static constexpr uint8_t kNoTile = 0xff;

  struct Region {
    std::array<std::shared_ptr<const FieldBlock>, kBlockVoxels> blocks;
    // State byte (FieldVoxel attribute bits 0-2) of blocks without a FieldBlock whose voxels are all
    // alike and farther than max_distance from any site; kNoTile = nothing known.
    std::array<uint8_t, kBlockVoxels> tiles;
    Region() { tiles.fill(kNoTile); }
  };

  DistanceField() = default;
  DistanceField(double voxel_size_m, double max_distance_m)
      : voxel_size_m_(voxel_size_m), max_distance_m_(max_distance_m) {}

  double voxel_size_m() const { return voxel_size_m_; }
  double max_distance_m() const { return max_distance_m_; }
  bool empty() const { return regions_.empty(); }

  // nullptr where nothing is stored. `region` = block index / 8, rounded down.
  const Region* FindRegion(const BlockIndex& region) const {
    auto it = regions_.find(region);
    return it == regions_.end() ? nullptr : it->second.get();
  }
  const FieldBlock* FindBlock(const BlockIndex& block) const {
    const Region* region = FindRegion({block.x >> 3, block.y >> 3, block.z >> 3});
    return region ? region->blocks[RegionOffset(block)].get() : nullptr;
  }
  // The voxel's stored value; a tile or nothing gives a voxel without a site and the tile's state.
  FieldVoxel At(const VoxelIndex& v) const;

  static int RegionOffset(const BlockIndex& b) {
    return ((b.x & 7) << 6) | ((b.y & 7) << 3) | (b.z & 7);
  }

  // Writers only. nullptr block and kNoTile remove.
  void Set(const BlockIndex& block, std::shared_ptr<const FieldBlock> data, uint8_t tile = kNoTile);

  // Every stored block in sorted order: fn(index, block or nullptr, tile).
  void ForEach(const std::function<void(const BlockIndex&, const std::shared_ptr<const FieldBlock>&,
                                        uint8_t tile)>& fn) const;
  size_t BlockCount() const;
  uint64_t MemoryBytes() const;

 private:
  double voxel_size_m_ = 0.1;
  double max_distance_m_ = 5.0;
  absl::flat_hash_map<BlockIndex, std::shared_ptr<const Region>> regions_;
};

}  // namespace clearance
