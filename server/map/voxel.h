// The one road from a coordinate to a voxel. Cells are centred: voxel i covers [i h, (i + 1) h) and its
// centre is at (i + 1/2) h. Blocks are 8^3 voxels and coincide with OpenVDB's leaves, offsets included.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace clearance {

using VoxelIndex = Eigen::Vector3i;

inline constexpr int kBlockSide = 8;
inline constexpr int kBlockVoxels = kBlockSide * kBlockSide * kBlockSide;

// Index of a block: voxel index / 8, rounded down. Ordered by x, then y, then z.
struct BlockIndex {
  int32_t x = 0, y = 0, z = 0;

  friend auto operator<=>(const BlockIndex&, const BlockIndex&) = default;
  template <typename H>
  friend H AbslHashValue(H h, const BlockIndex& b) {
    return H::combine(std::move(h), b.x, b.y, b.z);
  }
};

inline VoxelIndex VoxelOf(const Eigen::Vector3d& p, double voxel_size_m) {
  return {static_cast<int>(std::floor(p.x() / voxel_size_m)),
          static_cast<int>(std::floor(p.y() / voxel_size_m)),
          static_cast<int>(std::floor(p.z() / voxel_size_m))};
}

inline Eigen::Vector3d VoxelCentre(const VoxelIndex& v, double voxel_size_m) {
  return (v.cast<double>() + Eigen::Vector3d::Constant(0.5)) * voxel_size_m;
}

inline BlockIndex BlockOf(const VoxelIndex& v) { return {v.x() >> 3, v.y() >> 3, v.z() >> 3}; }

// Offset of a voxel in its block, 0..511, x slowest (as in OpenVDB's leaves).
inline int OffsetOf(const VoxelIndex& v) {
  return ((v.x() & 7) << 6) | ((v.y() & 7) << 3) | (v.z() & 7);
}

inline VoxelIndex FirstVoxel(const BlockIndex& b) { return {b.x * 8, b.y * 8, b.z * 8}; }

inline VoxelIndex VoxelAt(const BlockIndex& b, int offset) {
  return FirstVoxel(b) + VoxelIndex(offset >> 6, (offset >> 3) & 7, offset & 7);
}

// Lower corner of a block in metres: the local origin for float arithmetic.
inline Eigen::Vector3d BlockOrigin(const BlockIndex& b, double voxel_size_m) {
  return FirstVoxel(b).cast<double>() * voxel_size_m;
}

// One bit a voxel, word x holds the 64 voxels with that x offset.
using BlockMask = std::array<uint64_t, 8>;
inline bool Test(const BlockMask& m, int offset) { return (m[offset >> 6] >> (offset & 63)) & 1; }
inline void Set(BlockMask& m, int offset) { m[offset >> 6] |= uint64_t{1} << (offset & 63); }
inline constexpr BlockMask kFullMask = {~0ull, ~0ull, ~0ull, ~0ull, ~0ull, ~0ull, ~0ull, ~0ull};

}  // namespace clearance
