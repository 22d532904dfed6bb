#pragma once

#include "planner_demo/sim/motion.h"
#include "planner_demo/sim/random.h"

namespace clearance::sim {

// How a vehicle of busy traffic drives its path; nothing of it can be seen in advance.
enum class Manner { kSteady, kSlowsDown, kStopsAndStarts };

// Speeds from `speed_mps` with the manner's changes begun at `from_s`; braking is at 2.5 to 4
// m/s^2, starting at 1.5 to 2.5 m/s^2.
std::vector<Path::SpeedKnot> DrawSpeeds(Manner manner, double speed_mps, double from_s,
                                        Random& random);

// A path with one arc, driven so that the arc begins at `turn_at_s`: the vehicle comes at
// `speed_mps`, brakes to `turn_mps` just before the arc, and speeds up behind it. `path` has its
// stretches {straight, arc}; speeds and start offset are filled in.
void TimeTurn(double speed_mps, double turn_mps, double turn_at_s, Path& path);

}  // namespace clearance::sim
