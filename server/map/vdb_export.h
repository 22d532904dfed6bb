// OpenVDB files (.vdb) of what a map holds.
#pragma once

#include <openvdb/openvdb.h>

#include <string>

#include "absl/status/statusor.h"
#include "server/map/distance_field.h"
#include "server/map/surface_map.h"

namespace clearance {

// Deep copies of the fused grids, named "mean" (metres) and "weight": the map may go on meanwhile.
openvdb::FloatGrid::Ptr CopyMean(const SurfaceMap& map);
openvdb::FloatGrid::Ptr CopyWeight(const SurfaceMap& map);

// "distance": signed, metres, active where a site is within the field's maximum; the background is
// that maximum.
openvdb::FloatGrid::Ptr DistanceGrid(const DistanceField& field);
// "free_space": 1 free, 2 occupied as in the state byte; unknown is inactive, background 0. Uniform
// blocks are tiles.
openvdb::Int32Grid::Ptr FreeSpaceGrid(const DistanceField& field);

// One file with all grids, as bytes. INTERNAL where OpenVDB fails.
absl::StatusOr<std::string> WriteVdb(const openvdb::GridCPtrVec& grids);

// The grids of a file's bytes. DATA_LOSS where they are no .vdb file.
absl::StatusOr<openvdb::GridPtrVec> ReadVdb(std::string bytes);

}  // namespace clearance
