// Which cubes true surface lies in or near, from a triangle mesh.
#pragma once

#include "tests/evaluation/voxel_box.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::evaluation {

inline constexpr uint8_t kContainsSurface = 1;  // a triangle meets the closed cube
inline constexpr uint8_t kNearSurface = 2;      // a triangle is within a voxel of the centre

// Marks the voxels of `box` with the bits above.
void MarkSurface(const testing::TriangleMesh& mesh_W, double h, VoxelBox<uint8_t>& box);

}  // namespace clearance::evaluation
