#include "server/query/unknown_distance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#ifdef __AVX2__
#include <immintrin.h>
#endif

namespace clearance {
namespace {

constexpr size_t kMaxSummaries = 1 << 15;

double Squared(double x) { return x * x; }

// Distance from x to the interval [low, low + side].
double Outside(double x, double low, double side) {
  return std::max({low - x, x - low - side, 0.0});
}

bool IsUnknown(uint8_t tile) { return (tile & 3) == static_cast<uint8_t>(VoxelState::kUnknown); }

// Attributes of a voxel in the top 16 bits of its 8 bytes: state and side.
constexpr uint64_t kStateBits = uint64_t{3} << 48, kInnerBit = uint64_t{8} << 48;

// The voxels of a block for which (bits & mask) == value.
template <uint64_t mask, uint64_t value>
BlockMask Select(const FieldBlock& block) {
  BlockMask selected{};
  const char* voxels = reinterpret_cast<const char*>(block.voxels.data());
  for (int x = 0; x < 8; ++x) {
    uint64_t row = 0;
    for (int i = 0; i < 64; i += 4) {
#ifdef __AVX2__
      const __m256i four = _mm256_load_si256(
          reinterpret_cast<const __m256i*>(voxels + (x * 64 + i) * sizeof(FieldVoxel)));
      const __m256i same = _mm256_cmpeq_epi64(_mm256_and_si256(four, _mm256_set1_epi64x(mask)),
                                              _mm256_set1_epi64x(value));
      const auto bits = static_cast<unsigned>(_mm256_movemask_pd(_mm256_castsi256_pd(same)));
      row |= uint64_t{bits} << i;
#else
      for (int k = 0; k < 4; ++k) {
        uint64_t voxel;
        std::memcpy(&voxel, voxels + (x * 64 + i + k) * sizeof(FieldVoxel), sizeof(voxel));
        row |= uint64_t{(voxel & mask) == value} << (i + k);
      }
#endif
    }
    selected[x] = row;
  }
  return selected;
}

// Squared distance along an axis from p to the nearest of the voxels [0, 8) whose bits are set.
double NearestInRow(unsigned row, double p, const double along[8]) {
  const int at = std::clamp(static_cast<int>(std::floor(p)), 0, 7);
  const unsigned above = row >> at, below = row & ((2u << at) - 1);
  double best = 1e30;
  if (above != 0) best = along[at + std::countr_zero(above)];
  if (below != 0) best = std::min(best, along[31 - std::countl_zero(below)]);
  return best;
}

}  // namespace

const UnknownSearch::Block& UnknownSearch::Summary(const BlockIndex& block) {
  // Points far from one another share nothing: what is kept stays at a few megabytes.
  if (summaries_.size() >= kMaxSummaries) summaries_.clear();
  auto [it, inserted] = summaries_.try_emplace(block);
  if (!inserted) return it->second;
  Block& summary = it->second;
  const bool unknown = sought_ == Sought::kUnknown;
  const DistanceField::Region* region =
      field_.FindRegion({block.x >> 3, block.y >> 3, block.z >> 3});
  const FieldBlock* data = nullptr;
  uint8_t tile = DistanceField::kNoTile;
  if (region != nullptr) {
    const int offset = DistanceField::RegionOffset(block);
    data = region->blocks[offset].get();
    tile = region->tiles[offset];
  }
  if (data == nullptr) {
    // What tiles stand for is far from every surface.
    const bool all = unknown && (tile == DistanceField::kNoTile || IsUnknown(tile));
    summary.content = all ? Content::kAll : Content::kNone;
    return summary;
  }
  summary.sought = unknown ? Select<kStateBits, 0>(*data) : Select<kInnerBit, kInnerBit>(*data);
  uint64_t any = 0, all = ~uint64_t{0};
  for (const uint64_t row : summary.sought) any |= row, all &= row;
  summary.content = any == 0              ? Content::kNone
                    : all == ~uint64_t{0} ? Content::kAll
                                          : Content::kMixed;
  return summary;
}

void UnknownSearch::SearchBlock(const BlockIndex& block, const Eigen::Vector3d& p_voxels,
                                double* best_squared) {
  const VoxelIndex first = FirstVoxel(block);
  const Eigen::Vector3d low = first.cast<double>();
  double bound = 0;
  for (int axis = 0; axis < 3; ++axis) bound += Squared(Outside(p_voxels[axis], low[axis], 8));
  if (bound >= *best_squared) return;
  const Block& summary = Summary(block);
  if (summary.content == Content::kNone) return;
  if (summary.content == Content::kAll) {
    *best_squared = bound;
    return;
  }
  double along[3][8];
  for (int axis = 0; axis < 3; ++axis) {
    for (int i = 0; i < 8; ++i) along[axis][i] = Squared(Outside(p_voxels[axis], low[axis] + i, 1));
  }
  for (int x = 0; x < 8; ++x) {
    if (summary.sought[x] == 0 || along[0][x] >= *best_squared) continue;
    for (int y = 0; y < 8; ++y) {
      const auto row = static_cast<unsigned>(summary.sought[x] >> (8 * y)) & 0xff;
      const double beside = along[0][x] + along[1][y];
      if (row == 0 || beside >= *best_squared) continue;
      *best_squared =
          std::min(*best_squared, beside + NearestInRow(row, p_voxels.z() - low.z(), along[2]));
    }
  }
}

float UnknownSearch::Distance(const Eigen::Vector3d& p_W, double max_distance_m) {
  const double voxel_size_m = field_.voxel_size_m();
  const Eigen::Vector3d p_voxels = p_W / voxel_size_m;
  const BlockIndex centre = BlockOf(VoxelOf(p_W, voxel_size_m));
  const double limit_voxels = max_distance_m / voxel_size_m;
  double best_squared = Squared(limit_voxels);
  const int last_ring = static_cast<int>(limit_voxels / kBlockSide) + 1;
  for (int ring = 0; ring <= last_ring; ++ring) {
    // Everything in ring r is at least r - 1 whole blocks away.
    if (ring > 0 && Squared((ring - 1) * kBlockSide) >= best_squared) break;
    for (int x = -ring; x <= ring; ++x) {
      for (int y = -ring; y <= ring; ++y) {
        const bool inner = std::abs(x) != ring && std::abs(y) != ring;
        const int step = inner ? std::max(2 * ring, 1) : 1;
        for (int z = -ring; z <= ring; z += step) {
          SearchBlock({centre.x + x, centre.y + y, centre.z + z}, p_voxels, &best_squared);
        }
      }
    }
  }
  return static_cast<float>(std::sqrt(best_squared) * voxel_size_m);
}

}  // namespace clearance
