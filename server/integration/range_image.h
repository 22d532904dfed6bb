// A frame as an image of measured ranges: what the sensor saw along each direction.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "server/core/frame.h"

namespace clearance {

// Pinhole depth (measure = z) or spherical range (measure = distance from the sensor), in the sensor
// frame X. 0 = no return: no evidence. Immutable once built; safe to read from many threads.
class RangeImage {
 public:
  // Returns beyond max_range_m keep their measure for free space up to max_range_m, but carry no
  // surface (has_surface is false).
  static RangeImage FromDepth(const DepthImage& depth, double max_range_m);
  // Pixels of `pixel_rad` over the cloud's field of view; the nearest return of a pixel wins.
  static RangeImage FromCloud(const PointCloud& cloud, double pixel_rad, double max_range_m);

  bool is_pinhole() const { return pinhole_; }
  int width() const { return width_; }
  int height() const { return height_; }

  // Where a point of X falls: continuous pixel coordinates (centres at integers) and the measure that a
  // surface there would have. Absent behind the camera or outside the image.
  struct Projection {
    float u, v, measure;
  };
  std::optional<Projection> Project(const Eigen::Vector3f& p_X) const;

  float measure(int u, int v) const { return measure_[v * width_ + u]; }
  uint16_t label(int u, int v) const { return labels_.empty() ? 0 : labels_[v * width_ + u]; }
  // Point of X measured by a pixel; undefined where measure is 0.
  Eigen::Vector3f Point(int u, int v) const;
  const std::vector<float>& measures() const { return measure_; }

  double max_range_m() const { return max_range_m_; }
  // Angle of one pixel at the image centre, rad.
  double pixel_rad() const { return pixel_rad_; }

 private:
  bool pinhole_ = true;
  int width_ = 0, height_ = 0;
  float fx_ = 1, fy_ = 1, cx_ = 0, cy_ = 0;          // pinhole
  float azimuth0_ = 0, elevation0_ = 0;              // spherical: of pixel (0, 0)
  double pixel_rad_ = 0, max_range_m_ = 0;
  std::vector<float> measure_;
  std::vector<uint16_t> labels_;
};

}  // namespace clearance
