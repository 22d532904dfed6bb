#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner_demo/sim/scene.h"

namespace clearance::sim {

// Names that MakeScene knows.
std::vector<std::string> SceneNames();

// The scene of that name, or nothing for an unknown one. `frame_count` 0 takes the scene's own;
// scripted motions stay free of collisions up to the last future frame.
std::optional<Scene> MakeScene(std::string_view name, uint64_t seed, int frame_count = 0);

// A four-way crossing: ten vehicles at 5 to 12 m/s and two pedestrians; a lidar stands at the kerb.
Scene MakeCrossing(uint64_t seed, int frame_count);
// The same town for planners: traffic that keeps coming, turns, brakes, stops and starts.
Scene MakeBusyCrossing(uint64_t seed, int frame_count);
// A street with traffic both ways between parked cars, in the same manner.
Scene MakeBusyStreet(uint64_t seed, int frame_count);
// A depth camera drives down a street with parked and moving vehicles.
Scene MakeStreet(uint64_t seed, int frame_count);
// A depth camera flies around one moving car.
Scene MakeOrbit(uint64_t seed, int frame_count);
// Four cubes swing with free rotation in a room, seen by a depth camera.
Scene MakeCubes(uint64_t seed, int frame_count);
// A lidar is carried through a hall with twelve walkers.
Scene MakeHall(uint64_t seed, int frame_count);
// One car parks, one that stood drives off, one stops and goes on, seen by a lidar.
Scene MakeParking(uint64_t seed, int frame_count);
// One analytic shape seen by a depth camera from several sides: plane, box, sphere, corner, pole.
Scene MakeAnalytic(std::string_view shape, uint64_t seed, int frame_count);

}  // namespace clearance::sim
