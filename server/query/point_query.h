// Distances at points, on one view of the map (paper Sec. III-E, with the minimum as the default).
#pragma once

#include <Eigen/Core>

#include "absl/status/status.h"
#include "server/map/map_view.h"
#include "server/query/query_options.h"

namespace clearance {

// Whether the options fit the view and the number of points. INVALID_ARGUMENT or OUT_OF_RANGE (a
// horizon below 0 or beyond config.max_horizon_s) or NOT_FOUND (an object that the view does not
// have), naming field, index, got and limit.
absl::Status ValidateQuery(const MapView& view, Eigen::Index points, const QueryOptions& options);

// Signed distance from each column of `points_W` (metres, W) to the nearest surface of the static
// map and of the objects at the horizon. Pure; any number of threads may ask the same view.
//
// Static: near a surface the trilinear blend of the corners' signed distances to their surfels,
// farther the smallest distance to the eight corners' sites (never less than the true distance to
// the sites). Objects: exact minimum over the surfels of all of them, culled by bounds that never
// drop one. Objects that are RETIRED do not count; LOST ones do, at the pose they coast to.
//
// Corners: where nothing is within the maximum the distance is the maximum, with kClamped and
// kNoGradient. State: the voxel's that holds the point; OCCUPIED also where an object's surface
// passes through the voxel's cube or the cube's centre is inside an object. With only_objects the
// static map still says what is known, but its surfaces read as free at low confidence. A point
// that is not finite or beyond the range of voxel indices reads as unknown, outside, clamped.
// kWeighted: sum(w d) / sum(w) over the maps within the maximum, w = max(0.01, 1 - sigma / voxel
// size), Eq. (5)'s weight; state and object id stay those of the nearest map.
DistanceBatch QueryDistances(const MapView& view, const Eigen::Matrix3Xd& points_W,
                             const QueryOptions& options = {});

}  // namespace clearance
