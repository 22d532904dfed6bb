// A frame's points of one map (static or one object), gathered by voxel: the paper's local VDB.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/core/pose.h"
#include "server/map/voxel.h"

namespace clearance {

// Surface voxels of one frame in the map frame M (W for the static map, L for an object), grouped
// by block; blocks sorted, voxels by rising offset. All arrays run over voxels.
struct LocalVoxels {
  struct Block {
    BlockIndex block;
    uint32_t begin = 0, end = 0;
  };
  double voxel_size_m = 0.1;
  std::vector<Block> blocks;
  std::vector<uint16_t> offset;
  std::vector<Eigen::Vector3f> centroid;  // of the points, metres from the block's origin
  std::vector<uint32_t> count;            // points

  bool empty() const { return offset.empty(); }
};

// points_X: 3 x n in the sensor frame; indices into it select this map's points.
// T_M_X maps sensor coordinates to M. Deterministic.
LocalVoxels GatherVoxels(const Eigen::Matrix3Xf& points_X, const std::vector<uint32_t>& indices,
                         const Pose& T_M_X, double voxel_size_m);

// Voxels of both, of equal voxel size; where both have one, a's.
LocalVoxels Union(const LocalVoxels& a, const LocalVoxels& b);

}  // namespace clearance
