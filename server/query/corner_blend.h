// The distance between voxel centres: the eight FieldVoxels around a point become one answer.
#pragma once

#include "server/map/distance_field.h"
#include "server/query/static_lookup.h"

namespace clearance {

// `corners[4 i + 2 j + k]` is the voxel whose centre lies at (i, j, k); the point at `fraction`,
// each in [0, 1), all in voxels. Leaves `state` alone.
void BlendCorners(const FieldVoxel corners[8], const float fraction[3], StaticAnswer* answer);

}  // namespace clearance
