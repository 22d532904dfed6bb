#include "server/integration/range_image.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "server/integration/range_noise.h"

namespace clearance {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr size_t kGrain = 1 << 15;
// Sparse clouds do not make wider pixels than this: a pixel must stay a direction.
constexpr double kMaxPixelRad = 0.0175;
constexpr double kMinPixelRad = 1e-4;
// Missing azimuths up to this angle are returns that did not come back, not a border.
constexpr float kMaxClosedGapRad = 0.05f;

// atan2 to 2e-6 rad by an odd minimax polynomial; branch-free, so that loops over points vectorise.
inline float Atan2(float y, float x) {
  const float ax = std::abs(x), ay = std::abs(y);
  const float a = std::min(ax, ay) / std::max(std::max(ax, ay), std::numeric_limits<float>::min());
  const float t = a * a;
  float r = -0.0117191381f;
  r = r * t + 0.0526473579f;
  r = r * t - 0.116426488f;
  r = r * t + 0.193540379f;
  r = r * t - 0.332622828f;
  r = r * t + 0.999977219f;
  r *= a;
  r = ay > ax ? kPi / 2 - r : r;
  r = x < 0.f ? kPi - r : r;
  return y < 0.f ? -r : r;
}

struct Direction {
  float azimuth, elevation, range_m;  // range 0: no return
};

inline Direction DirectionOf(const Eigen::Vector3f& p) {
  const float xy = std::sqrt(p.x() * p.x() + p.y() * p.y());
  const float range_m = std::sqrt(xy * xy + p.z() * p.z());
  const bool usable = range_m > 0.f && range_m <= std::numeric_limits<float>::max();
  return {Atan2(p.y(), p.x()), Atan2(p.z(), xy), usable ? range_m : 0.f};
}

std::vector<Direction> Directions(const Eigen::Matrix3Xf& points_X) {
  std::vector<Direction> out(points_X.cols());
  tbb::parallel_for(tbb::blocked_range<size_t>(0, out.size(), kGrain), [&](const auto& range) {
    for (size_t i = range.begin(); i < range.end(); ++i) out[i] = DirectionOf(points_X.col(i));
  });
  return out;
}

// Azimuth brought into [azimuth0, azimuth0 + 2 pi), relative to azimuth0.
inline float Unwrap(float azimuth, float azimuth0) {
  const float a = azimuth - azimuth0;
  return a < 0.f ? a + 2 * kPi : (a >= 2 * kPi ? a - 2 * kPi : a);
}

struct FieldOfView {
  float azimuth0 = 0, azimuth_span = 0, elevation0 = 0, elevation_span = 0;
  float widest_gap = 2 * kPi;
  size_t returns = 0;
};

FieldOfView FindFieldOfView(const std::vector<Direction>& directions) {
  constexpr int kBins = 1440;
  constexpr float kBinRad = 2 * kPi / kBins;
  std::array<bool, kBins> seen{};
  float lowest = kPi, highest = -kPi;
  FieldOfView fov;
  for (const Direction& d : directions) {
    if (d.range_m == 0.f) continue;
    ++fov.returns;
    lowest = std::min(lowest, d.elevation);
    highest = std::max(highest, d.elevation);
    seen[std::clamp(static_cast<int>((d.azimuth + kPi) / kBinRad), 0, kBins - 1)] = true;
  }
  if (fov.returns == 0) return fov;
  fov.elevation0 = lowest;
  fov.elevation_span = highest - lowest;

  // The view starts behind the longest circular run of empty bins.
  int longest = 0, start = 0, run = 0;
  for (int i = 0; i < 2 * kBins; ++i) {
    run = seen[i % kBins] ? 0 : run + 1;
    if (run > longest && run < kBins) {
      longest = run;
      start = (i + 1) % kBins;
    }
  }
  fov.widest_gap = longest * kBinRad;
  const float from = start * kBinRad - kPi;
  float least = 2 * kPi, most = 0;
  for (const Direction& d : directions) {
    if (d.range_m == 0.f) continue;
    // A rounding error below the first bin must not turn the point around the circle.
    float a = Unwrap(d.azimuth, from);
    if (a > 2 * kPi - 0.5f * kBinRad && longest > 0) a -= 2 * kPi;
    least = std::min(least, a);
    most = std::max(most, a);
  }
  fov.azimuth0 = from + least;
  fov.azimuth_span = most - least;
  return fov;
}

}  // namespace

RangeImage RangeImage::FromDepth(const DepthImage& depth, double max_range_m) {
  RangeImage image;
  image.pinhole_ = true;
  image.width_ = static_cast<int>(depth.width);
  image.height_ = static_cast<int>(depth.height);
  image.fx_ = static_cast<float>(depth.fx);
  image.fy_ = static_cast<float>(depth.fy);
  image.cx_ = static_cast<float>(depth.cx);
  image.cy_ = static_cast<float>(depth.cy);
  image.pixel_rad_ = 1.0 / depth.fx;
  image.max_range_m_ = max_range_m;
  image.measure_.resize(depth.depth.size());
  const float scale = static_cast<float>(depth.depth_scale_m);
  tbb::parallel_for(tbb::blocked_range<size_t>(0, depth.depth.size(), kGrain),
                    [&](const auto& range) {
                      for (size_t i = range.begin(); i < range.end(); ++i) {
                        image.measure_[i] = static_cast<float>(depth.depth[i]) * scale;
                      }
                    });
  image.labels_ = depth.labels;
  image.FindBoxes();
  image.noise_m_ = EstimateNoise(image);
  return image;
}

RangeImage RangeImage::FromCloud(const PointCloud& cloud, double pixel_rad, double max_range_m) {
  RangeImage image;
  image.pinhole_ = false;
  image.max_range_m_ = max_range_m;
  const std::vector<Direction> directions = Directions(cloud.points_X);
  const FieldOfView fov = FindFieldOfView(directions);
  image.pixel_rad_ = pixel_rad;
  if (fov.returns == 0) return image;

  const double solid_angle =
      fov.azimuth_span * (std::sin(fov.elevation0 + fov.elevation_span) - std::sin(fov.elevation0));
  const double spacing_rad = std::sqrt(solid_angle / static_cast<double>(fov.returns));
  const double pitch = std::max({pixel_rad, std::min(spacing_rad, kMaxPixelRad), kMinPixelRad});
  image.pixel_rad_ = pitch;
  image.wraps_ = fov.widest_gap < std::max(kMaxClosedGapRad, static_cast<float>(3 * pitch));
  if (image.wraps_) {
    image.width_ = std::max(1, static_cast<int>(2 * kPi / pitch));
    image.azimuth_pixel_rad_ = 2 * kPi / static_cast<float>(image.width_);
  } else {
    image.width_ = static_cast<int>(fov.azimuth_span / pitch + 0.5) + 1;
    image.azimuth_pixel_rad_ = static_cast<float>(pitch);
  }
  image.height_ = static_cast<int>(fov.elevation_span / pitch + 0.5) + 1;
  image.azimuth0_ = fov.azimuth0;
  image.elevation0_ = fov.elevation0;

  const size_t pixels = static_cast<size_t>(image.width_) * image.height_;
  image.measure_.assign(pixels, 0.f);
  image.points_X_.assign(pixels, Eigen::Vector3f::Zero());
  if (!cloud.labels.empty()) image.labels_.assign(pixels, 0);
  for (size_t i = 0; i < directions.size(); ++i) {
    const Direction& d = directions[i];
    if (d.range_m == 0.f) continue;
    const Eigen::Vector3f p_X = cloud.points_X.col(i);
    const std::optional<Projection> at = image.Project(p_X);
    if (!at) continue;
    const size_t pixel =
        image.Index(static_cast<int>(std::lround(at->u)), static_cast<int>(std::lround(at->v)));
    float& measure = image.measure_[pixel];
    if (measure > 0.f && measure <= d.range_m) continue;
    measure = d.range_m;
    image.points_X_[pixel] = p_X;
    if (!cloud.labels.empty()) image.labels_[pixel] = cloud.labels[i];
  }
  image.FindBoxes();
  return image;
}

void RangeImage::FindBoxes() {
  if (labels_.empty()) return;
  const auto box_of = [this](uint16_t label) {
    for (size_t k = 0; k < boxes_.size(); ++k) {
      if (boxes_[k].first == label) return k;
    }
    boxes_.push_back({label, {width_, height_, -1, -1}});
    return boxes_.size() - 1;
  };
  for (int v = 0; v < height_; ++v) {
    const uint16_t* row = labels_.data() + Index(0, v);
    for (int u = 0; u < width_;) {
      uint64_t four = 0;
      if (u + 4 <= width_) std::memcpy(&four, row + u, sizeof(four));
      if (u + 4 <= width_ && four == 0) {
        u += 4;
        continue;
      }
      const uint16_t label = row[u];
      const int first = u;
      while (u < width_ && row[u] == label) ++u;
      if (label == 0) continue;
      PixelBox& box = boxes_[box_of(label)].second;
      box = {std::min(box.u0, first), std::min(box.v0, v), std::max(box.u1, u - 1),
             std::max(box.v1, v)};
    }
  }
}

RangeImage::PixelBox RangeImage::BoxOfObjects() const {
  PixelBox all{width_, height_, -1, -1};
  for (const auto& [label, box] : boxes_) {
    all = {std::min(all.u0, box.u0), std::min(all.v0, box.v0), std::max(all.u1, box.u1),
           std::max(all.v1, box.v1)};
  }
  return all;
}

RangeImage::PixelBox RangeImage::BoxOf(uint16_t label) const {
  if (label == 0) return {0, 0, width_ - 1, height_ - 1};
  for (const auto& [known, box] : boxes_) {
    if (known == label) return box;
  }
  return {};
}

std::optional<RangeImage::Projection> RangeImage::Project(const Eigen::Vector3f& p_X) const {
  Projection at;
  if (pinhole_) {
    if (!(p_X.z() > 0.f)) return std::nullopt;
    const float inverse = 1.f / p_X.z();
    at = {fx_ * p_X.x() * inverse + cx_, fy_ * p_X.y() * inverse + cy_, p_X.z()};
  } else {
    if (width_ == 0) return std::nullopt;
    const Direction d = DirectionOf(p_X);
    if (d.range_m == 0.f) return std::nullopt;
    // Half a pixel of room on the left, so that the border pixel's points stay its own.
    const float half = 0.5f * azimuth_pixel_rad_;
    const float azimuth = Unwrap(d.azimuth, azimuth0_ - half) - half;
    at = {azimuth / azimuth_pixel_rad_,
          (d.elevation - elevation0_) / static_cast<float>(pixel_rad_), d.range_m};
  }
  // Strictly inside, so that rounding to the nearest pixel never leaves the image.
  if (!(at.u > -0.5f && at.v > -0.5f && at.u < static_cast<float>(width_) - 0.5f &&
        at.v < static_cast<float>(height_) - 0.5f)) {
    return std::nullopt;
  }
  return at;
}

RangeImage::EightProjections RangeImage::ProjectEight(const Eigen::Vector3f& first_X,
                                                      const Eigen::Vector3f& step_X) const {
  EightProjections out;
  const float per_u = 1.f / azimuth_pixel_rad_, per_v = 1.f / static_cast<float>(pixel_rad_);
  const float half = 0.5f * azimuth_pixel_rad_;
  float u[8], v[8];
  for (int k = 0; k < 8; ++k) {
    const float t = static_cast<float>(k);
    const Direction d = DirectionOf(Eigen::Vector3f(
        first_X.x() + t * step_X.x(), first_X.y() + t * step_X.y(), first_X.z() + t * step_X.z()));
    u[k] = Unwrap(d.azimuth, azimuth0_ - half) * per_u;
    v[k] = (d.elevation - elevation0_) * per_v + 0.5f;
    out.measure[k] = d.range_m;
  }
  for (int k = 0; k < 8; ++k) {
    const bool inside = (u[k] >= 0.f) & (v[k] >= 0.f) & (u[k] < static_cast<float>(width_)) &
                        (v[k] < static_cast<float>(height_)) & (out.measure[k] > 0.f);
    out.inside[k] = inside;
    out.u[k] = inside ? static_cast<int>(u[k]) : 0;
    out.v[k] = inside ? static_cast<int>(v[k]) : 0;
  }
  return out;
}

Eigen::Vector3f RangeImage::Point(int u, int v) const {
  if (!pinhole_) return points_X_[Index(u, v)];
  const float z = measure(u, v);
  return {z * (static_cast<float>(u) - cx_) / fx_, z * (static_cast<float>(v) - cy_) / fy_, z};
}

}  // namespace clearance
