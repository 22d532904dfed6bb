#include "server/esdf/exact_transform.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace clearance {

ExactTransform::ExactTransform(absl::Span<const Eigen::Vector3d> sites, double voxel_size_m,
                               double max_distance_m)
    : voxel_size_m_(voxel_size_m),
      max_distance_m_(max_distance_m),
      positions_(sites.begin(), sites.end()),
      order_(sites.size()) {
  std::vector<BlockIndex> cell_of(sites.size());
  for (size_t i = 0; i < sites.size(); ++i) cell_of[i] = BlockOf(VoxelOf(sites[i], voxel_size_m));
  std::iota(order_.begin(), order_.end(), 0u);
  std::sort(order_.begin(), order_.end(), [&](uint32_t a, uint32_t b) {
    return cell_of[a] != cell_of[b] ? cell_of[a] < cell_of[b] : a < b;
  });
  for (uint32_t i = 0; i < order_.size(); ++i) {
    const BlockIndex& cell = cell_of[order_[i]];
    if (cells_.empty() || cells_.back().index != cell) cells_.push_back({cell, i, i});
    cells_.back().end = i + 1;
  }
}

const ExactTransform::Cell* ExactTransform::FindCell(const BlockIndex& index) const {
  const auto it =
      std::lower_bound(cells_.begin(), cells_.end(), index,
                       [](const Cell& cell, const BlockIndex& b) { return cell.index < b; });
  return it != cells_.end() && it->index == index ? &*it : nullptr;
}

ExactTransform::Nearest ExactTransform::Find(const Eigen::Vector3d& point) const {
  const double side = kBlockSide * voxel_size_m_;
  const BlockIndex home = BlockOf(VoxelOf(point, voxel_size_m_));
  const int shells = static_cast<int>(std::ceil(max_distance_m_ / side)) + 1;
  double best = max_distance_m_ * max_distance_m_;
  int64_t best_site = -1;
  const auto visit = [&](const Cell& cell) {
    for (uint32_t i = cell.begin; i < cell.end; ++i) {
      const double squared = (positions_[order_[i]] - point).squaredNorm();
      if (squared < best || (squared == best && (best_site < 0 || order_[i] < best_site))) {
        best = squared;
        best_site = order_[i];
      }
    }
  };
  for (int shell = 0; shell <= shells; ++shell) {
    // Cells of this shell are at least (shell - 1) sides away.
    const double bound = std::max(0, shell - 1) * side;
    if (bound * bound > best) break;
    for (int x = -shell; x <= shell; ++x) {
      for (int y = -shell; y <= shell; ++y) {
        const bool face = std::abs(x) == shell || std::abs(y) == shell;
        for (int z = -shell; z <= shell; z += face || shell == 0 ? 1 : 2 * shell) {
          if (const Cell* cell = FindCell({home.x + x, home.y + y, home.z + z})) visit(*cell);
        }
      }
    }
  }
  if (best_site < 0) return {};
  return {static_cast<int32_t>(best_site), std::sqrt(best)};
}

}  // namespace clearance
