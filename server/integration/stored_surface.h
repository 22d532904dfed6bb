// What the static map remembers of the surface in one block, and whether a ray contradicts it.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// The stored surface near a voxel is the plane of its mean and its gradient, not its cube: a ray
// that grazes true ground passes through surface cubes without ever being behind that plane.
class StoredSurface {
 public:
  StoredSurface() = default;
  StoredSurface(const SurfaceMap& map, const BlockIndex& block)
      : mean_(map.MeanBlock(block)),
        weight_(map.WeightBlock(block)),
        h_(static_cast<float>(map.voxel_size_m())) {}

  bool empty() const { return mean_ == nullptr || weight_ == nullptr; }

  // Surface in the cube, or behind it: a mean below 0.9 voxel (half a cube's diagonal).
  bool Holds(int offset) const { return weight_[offset] > 0.f && mean_[offset] < 0.9f * h_; }
  BlockMask HeldVoxels() const {
    BlockMask mask{};
    for (int o = 0; o < kBlockVoxels; ++o) {
      mask[o >> 6] |= static_cast<uint64_t>(Holds(o)) << (o & 63);
    }
    return mask;
  }

  float mean(int offset) const { return mean_[offset]; }
  float weight(int offset) const { return weight_[offset]; }

  // Unit gradient of the mean in the map's frame, from neighbours in the block; zero where these do
  // not tell. Differences above 1.5 voxels lie across two surfaces and are left out.
  Eigen::Vector3f Normal(int offset) const {
    Eigen::Vector3f g;
    for (int axis = 0, stride = 64; axis < 3; ++axis, stride >>= 3) {
      const int at = (offset / stride) & 7;
      float sum = 0.f;
      int sides = 0;
      if (at > 0 && weight_[offset - stride] > 0.f) {
        const float d = mean_[offset] - mean_[offset - stride];
        if (std::abs(d) < 1.5f * h_) sum += d, ++sides;
      }
      if (at < 7 && weight_[offset + stride] > 0.f) {
        const float d = mean_[offset + stride] - mean_[offset];
        if (std::abs(d) < 1.5f * h_) sum += d, ++sides;
      }
      g[axis] = sides ? sum / (static_cast<float>(sides) * h_) : 0.f;
    }
    const float length = g.norm();
    return length > 0.3f ? Eigen::Vector3f(g / length) : Eigen::Vector3f::Zero();
  }

 private:
  const float* mean_ = nullptr;
  const float* weight_ = nullptr;
  float h_ = 0.1f;
};

// How far a ray has to be behind the stored plane to contradict it, in voxels.
inline constexpr float kPenetrationVoxels = 0.5f;

}  // namespace clearance
