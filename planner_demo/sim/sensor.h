#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <variant>
#include <vector>

#include "planner_demo/sim/ray_caster.h"

namespace clearance::sim {

// Pinhole depth camera: x right, y down, z forward; pixel centres at integers.
struct DepthCamera {
  int width;
  int height;
  double fx, fy, cx, cy;
  double depth_scale_m;  // of the 16 bit depth image
  double max_range_m;    // along z

  // A camera with square pixels, its centre in the middle of the image.
  static DepthCamera WithHorizontalView(int width, int height, double horizontal_view_rad,
                                        double depth_scale_m, double max_range_m);
};

// Spinning lidar: x forward, y left, z up. Beams run from the highest to the lowest elevation,
// columns clockwise from behind (azimuth pi down to -pi).
struct Lidar {
  int beams;
  int columns;
  double elevation_min_rad;
  double elevation_max_rad;
  double max_range_m;
};

using Sensor = std::variant<DepthCamera, Lidar>;

int Rows(const Sensor& sensor);
int Columns(const Sensor& sensor);
double MaxRange(const Sensor& sensor);

// Directions of all rays in the sensor frame X, row by row. A camera's have z = 1, so that the ray
// parameter is the depth along z; a lidar's are unit vectors, so that it is the range.
std::vector<Eigen::Vector3d> RayDirections(const Sensor& sensor);

// One organised scan, row by row.
struct Scan {
  int rows = 0;
  int columns = 0;
  std::vector<double> ranges_m;  // the ray parameter; 0: no return
  std::vector<uint16_t> labels;  // 0: static, or no return
};

// Casts all rays of `sensor` (directions from RayDirections) at T_W_X.
Scan CastScan(const RayCaster& scene, const Sensor& sensor,
              const std::vector<Eigen::Vector3d>& directions_X, const Eigen::Isometry3d& T_W_X);

}  // namespace clearance::sim
