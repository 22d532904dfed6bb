// What cannot be nearer than how much while a ball's centre moves: lower bounds over an interval of
// time, from what is known at its ends.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "server/query/object_index.h"

namespace clearance {

// A centre's way from p(0) to p(1) in the time [horizon0_s, horizon1_s].
struct Sweep {
  Eigen::Vector3d p0_W, p1_W;
  double horizon0_s = 0, horizon1_s = 0;
  double travel_m = 0;     // no less than the length of the way
  double deviation_m = 0;  // no less than its distance from the straight line, at any time
};

// Least distance from points of a segment of length `length_m` to a set that keeps at least d0 from
// one end and d1 from the other: such a set lies outside both balls, and where they overlap its
// nearest point is on the circle in which they meet. 0 where they do not.
double LeastBetween(double d0_m, double d1_m, double length_m);

// One object that may come near a path, with bounds of its box as in ObjectIndex::Node.
struct NearObject {
  uint32_t entry = 0;
  Eigen::Array3f lower, upper, v_lower, v_upper;  // relative to the index's origin
  float acceleration_mps2 = 0;
  float sigma_m = 0, sigma_growth_mps = 0;  // upper bounds of a distance's sigma
};

// The objects whose distance less sigma_margin sigmas may be below `limit_m` for a point of
// `box_W` at some time in [horizon0_s, horizon1_s]. `enabled`: as ObjectQuery's.
void CollectNearObjects(const ObjectIndex& index, const std::vector<uint8_t>& enabled,
                        const Eigen::AlignedBox3d& box_W, double horizon0_s, double horizon1_s,
                        double sigma_margin, double limit_m, std::vector<NearObject>* near);

// No distance less sigma_margin sigmas to `object` during the sweep is below this: by its box
// alone.
double BoxBound(const ObjectIndex& index, const NearObject& object, const Sweep& sweep,
                double sigma_margin);

// The same from the distances (less the margin) at both ends, in the object's own frame, where the
// way is bent by its rotation. Minus infinity where the way may enter the box of its surface: there
// the side, and with it the sign, may change anywhere.
double SurfaceBound(const ObjectIndex& index, const NearObject& object, const Sweep& sweep,
                    double least0_m, double least1_m, double sigma_margin);

}  // namespace clearance
