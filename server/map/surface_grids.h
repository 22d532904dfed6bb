// The OpenVDB grids behind a SurfaceMap, all with cell-centred transforms.
#pragma once

#include <openvdb/openvdb.h>

namespace clearance {

struct SurfaceGrids {
  openvdb::FloatGrid::Ptr mean;      // mu_k, metres, active where fused
  openvdb::FloatGrid::Ptr weight;    // omega_k
  openvdb::Int32Grid::Ptr evidence;  // FreeEvidence::Pack(); whole free blocks are tiles
};

}  // namespace clearance
