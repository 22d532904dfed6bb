// What the sensor saw along the line to a point.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "server/field/lanes.h"
#include "server/integration/range_image.h"

namespace clearance {

struct Sight {
  bool usable = false;       // a return lies on the line of sight
  float in_front_m = 0;      // measured minus the point's own measure: > 0, the point is in front
  uint16_t label = 0;        // of the return
  bool edge_beyond = false;  // next to the line something is seen clearly farther than the point
};

// p_X in the sensor frame. The measure is the edge-aware mean over 3x3 pixels: neighbours within
// `voxel_size_m` of the middle one count. edge_beyond: some neighbour, or no return at all, lies
// more than half a voxel behind the point.
Sight LookTowards(const RangeImage& image, const Eigen::Vector3f& p_X, float voxel_size_m);

// The same for the first `count` of eight points, x, y and z apart.
std::array<Sight, kLanes> LookTowards(const RangeImage& image, const std::array<Lanes, 3>& p_X,
                                      size_t count, float voxel_size_m);

}  // namespace clearance
