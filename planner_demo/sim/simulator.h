#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <vector>

#include "planner_demo/sim/noise.h"
#include "planner_demo/sim/scene.h"

namespace clearance::sim {

// One frame as a front end would hand it on, and the truth beside it.
struct SimulatedFrame {
  struct Motion {
    uint16_t object_id;
    Eigen::Isometry3d H_W;  // moves world points of the object from the previous frame to this one
  };

  int frame = 0;
  double time_s = 0.0;
  Eigen::Isometry3d T_W_X = Eigen::Isometry3d::Identity();
  Scan scan;
  // Of every mover that had a label in an earlier frame, in view now or not.
  std::vector<Motion> motions;

  std::map<uint16_t, int> true_pixels;  // per mover in view, before any label noise
};

// Plays a scene frame by frame. The same scene, noise and seed give the same frames.
class Simulator {
 public:
  Simulator(Scene scene, const NoiseOptions& noise, uint64_t seed);

  const Scene& scene() const { return scene_; }
  double TimeOf(int frame) const { return frame / scene_.rate_hz; }

  // The next frame, the first being 0.
  SimulatedFrame Next();

 private:
  void HideLateLabels(SimulatedFrame& frame);
  void AddMotions(SimulatedFrame& frame) const;

  Scene scene_;
  NoiseOptions noise_;
  uint64_t seed_;
  std::vector<Eigen::Vector3d> directions_X_;
  std::map<uint16_t, int> frames_in_view_;
  std::set<uint16_t> known_;  // had a label
  int next_frame_ = 0;
};

// The solids of a scene at one time, ready for rays; hits carry the mover's id.
RayCaster SceneAt(const Scene& scene, double time_s);

}  // namespace clearance::sim
