// Forgetting what is far away, by whole blocks.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "server/map/surface_map.h"

namespace clearance {

// The distance of blocks (of their centres, from `centre`) within which the share `keep` of all
// blocks lies; absent for an empty map.
std::optional<double> EvictionRadius(const SurfaceMap& map, const Eigen::Vector3d& centre,
                                     double keep);

// Makes every block farther than that unknown again. Returns those blocks, sorted.
std::vector<BlockIndex> EvictBeyond(SurfaceMap& map, const Eigen::Vector3d& centre,
                                    double radius_m);

}  // namespace clearance
