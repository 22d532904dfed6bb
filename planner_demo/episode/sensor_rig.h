// Frames as a front end on the robot would hand them on.
#pragma once

#include <cstdint>
#include <vector>

#include "client/types.h"
#include "planner_demo/sim/scene.h"

namespace clearance::demo {

struct RigNoise {
  double range_m = 0.02;   // standard deviation of each return
  double motion_m = 0.01;  // of each object's position, per axis
  int least_returns = 4;   // an object with fewer is not recognised: its points are left out
};

class SensorRig {
 public:
  // The same scene, seed and poses give the same frames.
  SensorRig(sim::Scene scene, const RigNoise& noise, uint64_t seed);

  // Frame `index` (stamp index / rate) seen from T_W_X: an organised cloud with the labels and
  // poses of the objects in view. `labelled` false: a front end that knows no objects.
  Frame See(uint64_t index, const Eigen::Isometry3d& T_W_X, bool labelled) const;

  double TimeOf(uint64_t index) const { return static_cast<double>(index) / scene_.rate_hz; }

 private:
  sim::Scene scene_;
  RigNoise noise_;
  uint64_t seed_;
  std::vector<Eigen::Vector3d> directions_X_;
};

// Takes static returns outside `near_W` off a frame: a robot that never gets there need not know
// more of far facades than that nothing comes out of them. Objects keep theirs.
void LeaveOutFarStatic(const Aabb& near_W, Frame& frame);

}  // namespace clearance::demo
