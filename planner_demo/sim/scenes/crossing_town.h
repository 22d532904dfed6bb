#pragma once

#include <Eigen/Geometry>

#include "planner_demo/sim/random.h"
#include "planner_demo/sim/scene.h"

namespace clearance::sim {

// Two roads along x and y that meet at the origin; traffic keeps right.
inline constexpr double kRoadHalfWidth_m = 4.5;
inline constexpr double kLane_m = 2.0;  // a lane's centre, from the middle of the road
inline constexpr double kKerbHeight_m = 0.15;
inline constexpr double kApproach_m = 60.0;  // paths start so far from the middle

Eigen::Isometry3d QuarterTurns(int count);

// Ground, pavements, buildings with gaps between them, trees, lamps and signs.
void AddCrossingTown(Random& random, Scene& scene);

}  // namespace clearance::sim
