// A frame as an image of measured ranges: what the sensor saw along each direction.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "server/core/frame.h"

namespace clearance {

// Pinhole depth (measure = z) or spherical range (measure = distance from the sensor), in the
// sensor frame X. 0 = no return: no evidence. Immutable once built; safe to read from many threads.
class RangeImage {
 public:
  // Returns beyond max_range_m keep their measure for free space up to max_range_m, but carry no
  // surface (has_surface is false).
  static RangeImage FromDepth(const DepthImage& depth, double max_range_m);
  // Pixels over the cloud's field of view, at least `pixel_rad` wide and no finer than the cloud's
  // mean spacing, so that pixels between samples are rare; the nearest return of a pixel wins and
  // brings its label (the first in the cloud, where several are equally near). Fields of view
  // across
  // +-180 deg start behind their widest gap; without a gap the image closes upon itself (wraps()).
  static RangeImage FromCloud(const PointCloud& cloud, double pixel_rad, double max_range_m);

  bool is_pinhole() const { return pinhole_; }
  int width() const { return width_; }
  int height() const { return height_; }
  // Column width() - 1 and column 0 are neighbours (spherical, full circle).
  bool wraps() const { return wraps_; }

  // Where a point of X falls: continuous pixel coordinates (centres at integers) and the measure
  // that a surface there would have. Absent behind the camera or outside the image; u and v round
  // to a pixel.
  struct Projection {
    float u, v, measure;
  };
  std::optional<Projection> Project(const Eigen::Vector3f& p_X) const;

  // Project for eight points on a line, spherical images only; false where it would be absent, and
  // pixel (0, 0) stands in for them.
  struct EightProjections {
    std::array<int, 8> u, v;
    std::array<float, 8> measure;
    std::array<bool, 8> inside;
  };
  EightProjections ProjectEight(const Eigen::Vector3f& first_X,
                                const Eigen::Vector3f& step_X) const;

  float measure(int u, int v) const { return measure_[Index(u, v)]; }
  uint16_t label(int u, int v) const { return labels_.empty() ? 0 : labels_[Index(u, v)]; }
  bool has_labels() const { return !labels_.empty(); }
  // Gives an image without labels static ones.
  void NeedLabels() {
    if (labels_.empty()) labels_.resize(measure_.size());
  }
  // Before the image is shared; `pixel` is v * width() + u. Only for images with labels.
  void set_label(size_t pixel, uint16_t label) { labels_[pixel] = label; }
  bool has_surface(int u, int v) const {
    const float m = measure(u, v);
    return m > 0.f && m <= static_cast<float>(max_range_m_);
  }
  // Point of X measured by a pixel; undefined where measure is 0.
  Eigen::Vector3f Point(int u, int v) const;
  const std::vector<float>& measures() const { return measure_; }

  double max_range_m() const { return max_range_m_; }
  // Standard deviation of the measure, see EstimateNoise; 0 for clouds.
  double noise_m() const { return noise_m_; }

  // The least box of pixels that holds every pixel of a label; for 0, the whole image.
  struct PixelBox {
    int u0 = 0, v0 = 0, u1 = -1, v1 = -1;  // both ends included
    bool empty() const { return u1 < u0; }
  };
  PixelBox BoxOf(uint16_t label) const;
  PixelBox BoxOfObjects() const;  // of all labels but 0
  // Angle of one pixel at the image centre, rad.
  double pixel_rad() const { return pixel_rad_; }
  // Pinhole intrinsics in pixels.
  float fx() const { return fx_; }
  float fy() const { return fy_; }
  float cx() const { return cx_; }
  float cy() const { return cy_; }

 private:
  void FindBoxes();
  size_t Index(int u, int v) const { return static_cast<size_t>(v) * width_ + u; }

  bool pinhole_ = true, wraps_ = false;
  int width_ = 0, height_ = 0;
  float fx_ = 1, fy_ = 1, cx_ = 0, cy_ = 0;  // pinhole
  float azimuth0_ = 0, elevation0_ = 0;      // spherical: of pixel (0, 0); both grow with u and v
  float azimuth_pixel_rad_ = 0;              // spherical: a full circle is a whole number of pixels
  double pixel_rad_ = 0, max_range_m_ = 0, noise_m_ = 0;
  std::vector<float> measure_;
  std::vector<uint16_t> labels_;
  std::vector<std::pair<uint16_t, PixelBox>> boxes_;  // of labels other than 0
  std::vector<Eigen::Vector3f> points_X_;             // spherical: the returns themselves
};

}  // namespace clearance
