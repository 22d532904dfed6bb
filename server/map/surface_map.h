// What is remembered of one map's surface and free space, in that map's own frame M (W or L).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "server/core/aabb.h"
#include "server/map/map_update.h"
#include "server/map/voxel.h"

namespace clearance {

// Counts of evidence stop here, so that wholly free blocks become alike and collapse to one tile.
inline constexpr uint8_t kSaturatedFrames = 15;

// Evidence for free space of one voxel. Packed in an Int32Grid so that other OpenVDB tools open it.
struct FreeEvidence {
  uint8_t confident = 0;     // frames that saw the whole cube empty (saturating)
  uint8_t probable = 0;      // frames in which a ray passed through, all confident ones included
  uint8_t contradicted = 0;  // consecutive frames that looked through the stored surface
  uint8_t returns = 0;       // frames with a static return in the cube (saturating)

  static FreeEvidence Unpack(int32_t packed) {
    return {static_cast<uint8_t>(packed), static_cast<uint8_t>(packed >> 8),
            static_cast<uint8_t>(packed >> 16), static_cast<uint8_t>(packed >> 24)};
  }
  int32_t Pack() const {
    return confident | (probable << 8) | (contradicted << 16) | (returns << 24);
  }
};

enum class RegionAction { kClearToUnknown, kMarkFree, kMarkOccupied };

// Halo copy of a block for kernels that look at neighbours: 10^3 values, x slowest, index 0 is
// voxel -1.
inline constexpr int kHaloSide = kBlockSide + 2;
inline constexpr int kHaloVoxels = kHaloSide * kHaloSide * kHaloSide;
inline constexpr int HaloOffset(int x, int y, int z) {  // -1..8 each
  return ((x + 1) * kHaloSide + (y + 1)) * kHaloSide + (z + 1);
}

// OpenVDB's headers are heavy: only surface_map.cc and exporters see them.
struct SurfaceGrids;

// Eq. (5)'s running mean and weight, and free-space evidence, as three OpenVDB grids with
// cell-centred transforms. Not thread-safe: one writer, no readers meanwhile.
class SurfaceMap {
 public:
  explicit SurfaceMap(double voxel_size_m);
  SurfaceMap(SurfaceMap&&) noexcept;
  SurfaceMap& operator=(SurfaceMap&&) noexcept;
  ~SurfaceMap();

  double voxel_size_m() const { return voxel_size_m_; }

  // The OpenVDB grids themselves, for export; include server/map/surface_grids.h.
  const SurfaceGrids& grids() const { return *grids_; }

  // Fuses the update: band by Eq. (5) with the weight capped, evidence counted, contradicted and
  // released surface removed. Returns the blocks whose mean, weight or evidence changed, sorted.
  // Deterministic for any number of threads.
  std::vector<BlockIndex> Apply(const SurfaceUpdate& update, const FusionOptions& options);

  // Overwrites the voxels whose centres lie in `region`: kClearToUnknown forgets them, kMarkFree
  // leaves saturated free evidence and no surface, kMarkOccupied writes `sdf` (metres, at voxel
  // centres, clamped to the truncation, which pads the region) at full weight. Returns the changed
  // blocks.
  std::vector<BlockIndex> Edit(RegionAction action, const Aabb& region,
                               const std::function<double(const Eigen::Vector3d&)>& sdf,
                               double truncation_m, const FusionOptions& options);

  // Direct reads of a block with a one-voxel halo; absent voxels have weight 0 and evidence 0.
  void ReadBand(const BlockIndex& block, float mean[kHaloVoxels], float weight[kHaloVoxels]) const;
  void ReadEvidence(const BlockIndex& block, int32_t evidence[kHaloVoxels]) const;
  FreeEvidence EvidenceAt(const VoxelIndex& v) const;
  // Leaf buffers without halo (512 values) or nullptr where there is no leaf.
  const float* MeanBlock(const BlockIndex& block) const;
  const float* WeightBlock(const BlockIndex& block) const;

  // Blocks that hold surface band (weight > 0 somewhere), sorted.
  std::vector<BlockIndex> BandBlocks() const;

  uint64_t MemoryBytes() const;

 private:
  double voxel_size_m_;
  std::unique_ptr<SurfaceGrids> grids_;
};

}  // namespace clearance
