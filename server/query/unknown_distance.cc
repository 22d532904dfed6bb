#include "server/query/unknown_distance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>

namespace clearance {
namespace {

constexpr size_t kMaxSummaries = 1 << 15;

double Squared(double x) { return x * x; }

// Distance from x to the interval [low, low + side].
double Outside(double x, double low, double side) {
  return std::max({low - x, x - low - side, 0.0});
}

bool IsUnknown(uint16_t attributes) {
  return static_cast<VoxelState>(attributes & 3) == VoxelState::kUnknown;
}

}  // namespace

const UnknownSearch::Block& UnknownSearch::Summary(const BlockIndex& block) {
  // Points far from one another share nothing: what is kept stays at a few megabytes.
  if (summaries_.size() >= kMaxSummaries) summaries_.clear();
  auto [it, inserted] = summaries_.try_emplace(block);
  if (!inserted) return it->second;
  Block& summary = it->second;
  const DistanceField::Region* region =
      field_.FindRegion({block.x >> 3, block.y >> 3, block.z >> 3});
  if (region == nullptr) return summary;
  const int offset = DistanceField::RegionOffset(block);
  const FieldBlock* data = region->blocks[offset].get();
  if (data == nullptr) {
    const uint8_t tile = region->tiles[offset];
    const bool unknown = tile == DistanceField::kNoTile || IsUnknown(tile);
    summary.content = unknown ? Content::kAllUnknown : Content::kNoneUnknown;
    return summary;
  }
  int count = 0;
  for (int i = 0; i < kBlockVoxels; ++i) {
    if (!IsUnknown(data->voxels[i].attributes)) continue;
    Set(summary.unknown, i);
    ++count;
  }
  summary.content = count == 0              ? Content::kNoneUnknown
                    : count == kBlockVoxels ? Content::kAllUnknown
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
  if (summary.content == Content::kNoneUnknown) return;
  if (summary.content == Content::kAllUnknown) {
    *best_squared = bound;
    return;
  }
  double along[3][8];
  for (int axis = 0; axis < 3; ++axis) {
    for (int i = 0; i < 8; ++i) along[axis][i] = Squared(Outside(p_voxels[axis], low[axis] + i, 1));
  }
  for (int x = 0; x < 8; ++x) {
    for (uint64_t rest = summary.unknown[x]; rest != 0; rest &= rest - 1) {
      const int yz = std::countr_zero(rest);
      *best_squared = std::min(*best_squared, along[0][x] + along[1][yz >> 3] + along[2][yz & 7]);
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
