#include "server/integration/placed_shape.h"

#include <cmath>
#include <utility>

namespace clearance {
PlacedShape::PlacedShape(const SurfaceMap& surface, const Pose& T_W_L)
    : h_(surface.voxel_size_m()), T_W_L_(T_W_L), T_L_W_(T_W_L.inverse()) {
  auto blocks = std::make_shared<absl::flat_hash_map<BlockIndex, StoredSurface>>();
  for (const BlockIndex& block : surface.BandBlocks()) {
    const Eigen::Vector3d low = BlockOrigin(block, h_);
    box_L_.extend(Aabb(low, low + Eigen::Vector3d::Constant(kBlockSide * h_)));
    blocks->emplace(block, StoredSurface(surface, block));
  }
  blocks_ = std::move(blocks);
}

PlacedShape PlacedShape::MovedTo(const Pose& T_W_L) const {
  PlacedShape moved = *this;
  moved.T_W_L_ = T_W_L;
  moved.T_L_W_ = T_W_L.inverse();
  return moved;
}

Aabb PlacedShape::box_W() const {
  Aabb box;
  if (box_L_.isEmpty()) return box;
  const Eigen::Vector3d half = T_W_L_.linear().cwiseAbs() * (0.5 * box_L_.sizes());
  const Eigen::Vector3d centre = T_W_L_ * box_L_.center();
  return {centre - half, centre + half};
}

std::optional<PlacedShape::Value> PlacedShape::At(const Eigen::Vector3d& p_W, double about_m,
                                                  double within_m) const {
  constexpr double kHalfDiagonalVoxels = 0.87;
  const Eigen::Vector3d p_L = T_L_W_ * p_W;
  if (!box_L_.contains(p_L)) return std::nullopt;
  const VoxelIndex v = VoxelOf(p_L, h_);
  const auto block = blocks_->find(BlockOf(v));
  const int o = OffsetOf(v);
  if (block == blocks_->end() || block->second.empty()) return std::nullopt;
  if (!(block->second.weight(o) > 0.f)) return std::nullopt;
  const double mean = block->second.mean(o);
  if (std::abs(mean - about_m) > within_m + kHalfDiagonalVoxels * h_) return std::nullopt;
  StoredSurface stored = block->second;  // it remembers what it looks up
  const Eigen::Vector3f normal_L = stored.Normal(o);
  const double along = normal_L.cast<double>().dot(p_L - VoxelCentre(v, h_));
  if (std::abs(mean + along - about_m) > within_m) return std::nullopt;
  return Value{mean + along, T_W_L_.linear().cast<float>() * normal_L};
}

}  // namespace clearance
