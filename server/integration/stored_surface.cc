#include "server/integration/stored_surface.h"

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

constexpr float kHeldVoxels = 0.9f;
constexpr float kMaxJumpVoxels = 1.5f;
constexpr float kMinSlope = 0.6f;  // of a mean that is a distance: 1
constexpr int kVotesAFrame = 3;
constexpr float kSlightWeight = 1.f;  // at most one good look
constexpr int kStride[3] = {64, 8, 1};

}  // namespace

StoredSurface::StoredSurface(const SurfaceMap& map, const BlockIndex& block)
    : map_(&map),
      block_(block),
      mean_(map.MeanBlock(block)),
      weight_(map.WeightBlock(block)),
      h_(static_cast<float>(map.voxel_size_m())) {}

BlockMask StoredSurface::HeldVoxels() const {
  BlockMask mask{};
  for (int o = 0; o < kBlockVoxels; ++o) {
    const bool held = (weight_[o] > 0.f) & (mean_[o] < kHeldVoxels * h_);
    mask[o >> 6] |= static_cast<uint64_t>(held) << (o & 63);
  }
  return mask;
}

const StoredSurface::Leaf& StoredSurface::Neighbour(int n) {
  if (!((looked_up_ >> n) & 1)) {
    const int axis = n >> 1, side = n & 1 ? 1 : -1;
    BlockIndex block = block_;
    (axis == 0 ? block.x : axis == 1 ? block.y : block.z) += side;
    neighbours_[n] = {map_->MeanBlock(block), map_->WeightBlock(block)};
    looked_up_ |= static_cast<uint8_t>(1 << n);
  }
  return neighbours_[n];
}

StoredSurface::Voxel StoredSurface::Across(int offset, int n) {
  const int stride = kStride[n >> 1];
  const int other = n & 1 ? offset - 7 * stride : offset + 7 * stride;
  const Leaf& leaf = Neighbour(n);
  if (!leaf.mean || !leaf.weight) return {0, 0, n, other};
  return {leaf.mean[other], leaf.weight[other], n, other};
}

StoredSurface::Around StoredSurface::AroundOf(int offset) {
  Around around;
  for (int n = 0; n < 6; ++n) {
    const int axis = n >> 1, at = (offset >> (6 - 3 * axis)) & 7;
    if (at == (n & 1 ? 7 : 0)) {
      around[n] = Across(offset, n);
    } else {
      const int other = offset + (n & 1 ? kStride[axis] : -kStride[axis]);
      around[n] = {mean_[other], weight_[other], 6, other};
    }
  }
  return around;
}

Eigen::Vector3f StoredSurface::Normal(int offset, const Around& around) const {
  const float own = mean_[offset], limit = kMaxJumpVoxels * h_;
  Eigen::Vector3f gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Voxel &before = around[2 * axis], &after = around[2 * axis + 1];
    const float below = own - before.mean, above = after.mean - own;
    const bool has_below = (before.weight > 0.f) & (std::abs(below) < limit);
    const bool has_above = (after.weight > 0.f) & (std::abs(above) < limit);
    if (!has_below && !has_above) return Eigen::Vector3f::Zero();
    const float sum = (has_below ? below : 0.f) + (has_above ? above : 0.f);
    gradient[axis] = has_below && has_above ? 0.5f * sum : sum;
  }
  const float length = gradient.norm();
  if (!(length > kMinSlope * h_)) return Eigen::Vector3f::Zero();
  return gradient / length;
}

bool IsRefuted(const SurfaceMap& map, const VoxelIndex& own, const VoxelIndex& site, int rays,
               int doubts) {
  const int before = map.EvidenceAt(own).contradicted, returns = map.EvidenceAt(site).returns;
  const int now = std::min(rays + doubts, kVotesAFrame);
  const float* weight = map.WeightBlock(BlockOf(own));
  const bool slight = returns == 0 && weight && weight[OffsetOf(own)] < kSlightWeight;
  const bool sure = rays > 0 || now == kVotesAFrame || before > 0 || slight;
  return sure && 2 * (before + now) > returns;
}

}  // namespace clearance
