#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <functional>
#include <string>

#include "planner_demo/sim/noise.h"
#include "planner_demo/sim/scene.h"

namespace clearance::sim {

struct SequenceOptions {
  uint64_t seed = 0;
  NoiseOptions noise;
  std::string source;                       // how to make it again, for sequence.json
  std::function<void(int frame)> progress;  // after each frame; may be empty
};

// Plays `scene` from its first to its last frame into a sequence folder:
//   sequence.json, trajectory.tum (T_W_X), object_motions.csv (H_W from frame - 1 to frame),
//   objects.csv (class and size of each object),
//   depth/ and label/ (camera) or cloud/ (lidar; returns only, in the sensor frame),
//   gt/objects/J.ply (body frame L), gt/object_poses.csv (T_W_L, future frames too),
//   gt/static.ply, gt/visibility.csv (pixels per object in view, before label noise).
// The folder is created; existing files of these names are replaced. ALREADY_EXISTS where the
// folder holds scans of another recording, UNAVAILABLE where a file cannot be written.
absl::Status WriteSequence(const Scene& scene, const SequenceOptions& options,
                           const std::string& folder);

}  // namespace clearance::sim
