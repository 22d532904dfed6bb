#pragma once

#include "planner_demo/sim/random.h"
#include "planner_demo/sim/scene.h"

namespace clearance::sim {

// A street along x from -30 m to `end_m`: lanes at y = +-2 (traffic keeps right), parked cars at
// +-5.4 m, pavements from 6.6 m, facades with doors from 9.5 m, lamps and trees; a side street
// opens on the left from x = 22 to 34 m.
void AddStreetSurroundings(Random& random, double end_m, Scene& scene);

}  // namespace clearance::sim
