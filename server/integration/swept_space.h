// Decision 9: where a moving object is or was, static surface that looks like it is its trace. Left
// by labels that ended before the object did, or came late.
#pragma once

#include <optional>
#include <vector>

#include "server/core/frame.h"
#include "server/integration/object_motion.h"
#include "server/integration/placed_shape.h"
#include "server/integration/range_image.h"
#include "server/integration/static_returns.h"
#include "server/map/map_update.h"
#include "server/map/world_map.h"

namespace clearance {

// The submaps whose pose is known in this frame, where they are now; by task, absent for the
// others.
std::vector<std::optional<PlacedShape>> ShapesInFrame(const std::vector<ObjectTask>& tasks,
                                                      const WorldMap& map);

// `static_points` (columns of points_X, in X) without those on the surface of a known object,
// unless the static map has seen surface there in many frames before. Their pixels in `image` get
// kRimLabel. Order is kept.
std::vector<uint32_t> WithoutObjectReturns(RangeImage& image, const Eigen::Matrix3Xf& points_X,
                                           std::vector<uint32_t> static_points, const Pose& T_W_X,
                                           const std::vector<std::optional<PlacedShape>>& shapes,
                                           const SurfaceMap& static_map);

// Static surface on that of an object in motion, and facing as it does, away from static returns of
// this frame: where the object is and, now and then while it is new, where it was and must have
// come from at its present motion. Sorted by block.
std::vector<ReleasedBlock> ReleaseSwept(const ObjectTask& task, const PlacedShape& now,
                                        const WorldMap& map, const StaticReturns& returns);

}  // namespace clearance
