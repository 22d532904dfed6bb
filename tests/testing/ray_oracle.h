// How many rays passed through each voxel, counted the slow and certain way.
#pragma once

#include <array>

#include "absl/container/flat_hash_map.h"
#include "tests/testing/ray_walk.h"

namespace clearance::testing {

class RayOracle {
 public:
  using Counts = std::array<uint16_t, kBlockVoxels>;

  explicit RayOracle(double voxel_size_m, double max_range_m)
      : h_(voxel_size_m), max_range_m_(max_range_m) {}

  // `depth_is_z`: max_range_m limits z, as for cameras; else the distance from the sensor.
  void Add(const Frame& frame) {
    const bool depth_is_z = std::holds_alternative<DepthImage>(frame.observation);
    ForEachReturn(frame, [&](const Eigen::Vector3d& p_X, uint16_t) {
      const double measure = depth_is_z ? p_X.z() : p_X.norm();
      const Eigen::Vector3d end_X = p_X * std::min(1.0, max_range_m_ / measure);
      WalkRay(frame.T_W_X.translation(), frame.T_W_X * end_X, h_,
              [&](const VoxelIndex& v, double, double) {
                uint16_t& n = blocks_[BlockOf(v)][OffsetOf(v)];
                n += n < UINT16_MAX;
              });
    });
  }

  int Rays(const VoxelIndex& v) const {
    const auto it = blocks_.find(BlockOf(v));
    return it == blocks_.end() ? 0 : it->second[OffsetOf(v)];
  }
  const absl::flat_hash_map<BlockIndex, Counts>& blocks() const { return blocks_; }

 private:
  double h_, max_range_m_;
  absl::flat_hash_map<BlockIndex, Counts> blocks_;
};

}  // namespace clearance::testing
