#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include "planner_demo/sim/sensor.h"

namespace clearance::sim {

// What a real front end gets wrong. All zero: exact data.
struct NoiseOptions {
  double depth_sigma_m = 0.0;  // of each return, along its ray parameter
  double motion_sigma_m =
      0.0;                    // of each reported motion, per axis; also 0.5 rad/m of it as rotation
  int label_shrink_px = 0;    // object borders lose so many pixels to the static world
  int label_grow_px = 0;      // object borders gain so many pixels
  int late_label_frames = 0;  // an object is labelled from its n-th frame in view on
};

// Returns with noise stay in (0, max_range]; others are lost, as in a real sensor.
void AddDepthNoise(double sigma_m, double max_range_m, uint64_t seed, int frame, Scan& scan);

// Object pixels within `pixels` (square neighbourhood) of another label become static. Columns of
// a lidar wrap around.
void ShrinkLabels(int pixels, bool wraps, Scan& scan);

// Static returns within `pixels` of an object take its label; between two objects the lower wins.
void GrowLabels(int pixels, bool wraps, Scan& scan);

// H_W with noise about the mover's origin `centre_W`, where turning it does not shift it.
Eigen::Isometry3d AddMotionNoise(const Eigen::Isometry3d& H_W, const Eigen::Vector3d& centre_W,
                                 double sigma_m, uint64_t seed, uint16_t object_id, int frame);

}  // namespace clearance::sim
