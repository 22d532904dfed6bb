// A horizontal cut as a picture.
#pragma once

#include <string>
#include <vector>

#include "client/draw/canvas.h"
#include "client/types.h"

namespace clearance::client {

struct SlicePicture {
  std::string title;
  double max_distance_m = 5;        // the colour scale ends here
  int target_width = 1200;          // of the map area, about
  std::vector<ObjectInfo> objects;  // outlines, arrows, trajectories; retired ones are left out
  std::vector<StampedPose> sensor_path;  // the last one is the sensor's place now
};

// Free space as a heat map of the distance, occupied dark, unknown hatched,
// low confidence paler; objects with outline, velocity (its length is one second) and trajectory;
// the sensor's path; scale bar and legend. y points up, x right.
Canvas DrawSlice(const Slice& slice, const SlicePicture& picture);

// The colour of a distance between 0 (warm) and max (cool).
Color HeatColor(double distance_m, double max_distance_m);

}  // namespace clearance::client
