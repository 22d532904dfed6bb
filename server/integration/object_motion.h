// The paper's L_k = H L_{k-1}, and what it leaves open: gaps, first sight, other sources,
// re-anchoring.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/core/frame.h"
#include "server/map/map_update.h"
#include "server/map/world_map.h"

namespace clearance {

// One object's part of a frame, before its points are integrated.
struct ObjectTask {
  ObjectUpdate update;           // pose and event decided
  std::vector<uint32_t> points;  // indices of its points, empty when unseen
  bool integrate = false;        // its points have a usable pose
};

// The labelled points of a frame: indices by object id.
using LabelledPoints = std::map<ObjectId, std::vector<uint32_t>>;

// Decides the pose of every object that `frame`'s source owns or shows. A motion that cannot be
// used is a violation and concerns its object alone: it coasts (design.md, decision 8). Points of
// an object without a usable pose go nowhere. Pure.
std::vector<ObjectTask> FollowObjects(const Frame& frame, const Eigen::Matrix3Xf& points_X,
                                      LabelledPoints labelled, size_t min_points,
                                      const WorldMap& map, std::vector<Violation>& violations);

}  // namespace clearance
