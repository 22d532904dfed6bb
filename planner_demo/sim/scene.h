#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "planner_demo/sim/motion.h"
#include "planner_demo/sim/sensor.h"
#include "planner_demo/sim/solid.h"

namespace clearance::sim {

// A rigid object with a scripted motion.
struct Mover {
  uint16_t id;  // 1..65535, the label in scans
  std::string class_name;
  std::vector<Solid> solids;  // in the body frame L
  PoseFunction T_W_L;
};

// Everything that a recording shows: known at any time, so futures are exact.
struct Scene {
  std::string name;
  std::string notes;
  std::vector<Solid> static_solids;  // in W
  std::vector<Mover> movers;
  Sensor sensor;
  PoseFunction T_W_X;
  double rate_hz = 10.0;
  double voxel_size_m = 0.2;
  int frame_count = 60;    // unless the caller asks for another number
  int future_frames = 30;  // frames of ground truth after the last one
};

// Exact distance in metres from a world point to the nearest surface at a time; negative inside.
// Zero-based index of the mover that decides, or -1 for the static world, goes to `mover` if given.
double TrueDistance(const Scene& scene, const Eigen::Vector3d& point_W, double time_s,
                    int* mover = nullptr);

}  // namespace clearance::sim
