#include "tests/testing/analytic_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace clearance::testing {
namespace {

using Eigen::Vector3d;

const Solid& NearestSolid(const std::vector<Solid>& solids, const Vector3d& p_W) {
  return *std::min_element(solids.begin(), solids.end(), [&](const Solid& a, const Solid& b) {
    return a.Distance(p_W) < b.Distance(p_W);
  });
}

bool AnyLabel(const std::vector<Solid>& solids) {
  return std::any_of(solids.begin(), solids.end(), [](const Solid& s) { return s.label != 0; });
}

}  // namespace

double AnalyticScene::Distance(const Vector3d& p_W) const {
  double d = std::numeric_limits<double>::infinity();
  for (const Solid& s : solids_) d = std::min(d, s.Distance(p_W));
  return d;
}

Vector3d AnalyticScene::Gradient(const Vector3d& p_W) const {
  return NearestSolid(solids_, p_W).Gradient(p_W);
}

Vector3d AnalyticScene::NearestSurface(const Vector3d& p_W) const {
  const Solid& s = NearestSolid(solids_, p_W);
  return p_W - s.Distance(p_W) * s.Gradient(p_W);
}

std::optional<AnalyticScene::Hit> AnalyticScene::Cast(const Vector3d& origin_W,
                                                      const Vector3d& direction_W) const {
  std::optional<Hit> best;
  for (const Solid& s : solids_) {
    if (auto t = s.Cast(origin_W, direction_W); t && (!best || *t < best->t)) best = {*t, s.label};
  }
  return best;
}

DepthImage AnalyticScene::RenderDepth(const Pose& T_W_X, const Intrinsics& k, double noise_m,
                                      uint32_t seed) const {
  DepthImage image;
  image.width = k.width;
  image.height = k.height;
  image.fx = k.fx;
  image.fy = k.fy;
  image.cx = k.cx;
  image.cy = k.cy;
  image.depth_scale_m = k.depth_scale_m;
  image.depth.assign(size_t{k.width} * k.height, 0);
  if (AnyLabel(solids_)) image.labels.assign(image.depth.size(), 0);
  std::mt19937 rng(seed);
  std::normal_distribution<double> gauss;
  size_t i = 0;
  for (uint32_t v = 0; v < k.height; ++v) {
    for (uint32_t u = 0; u < k.width; ++u, ++i) {
      const Vector3d ray_X((u - k.cx) / k.fx, (v - k.cy) / k.fy, 1.0);
      const auto hit = Cast(T_W_X.translation(), T_W_X.linear() * ray_X);
      if (!hit || hit->t > k.max_range_m) continue;
      const double z = hit->t + (noise_m > 0 ? noise_m * gauss(rng) : 0.0);
      image.depth[i] =
          static_cast<uint16_t>(std::clamp(std::lround(z / k.depth_scale_m), long{1}, long{65535}));
      if (!image.labels.empty()) image.labels[i] = hit->label;
    }
  }
  return image;
}

PointCloud AnalyticScene::RenderLidar(const Pose& T_W_X, const LidarModel& lidar, double noise_m,
                                      uint32_t seed) const {
  PointCloud cloud;
  cloud.rows = lidar.rows;
  cloud.columns = lidar.columns;
  const size_t n = size_t{lidar.rows} * lidar.columns;
  cloud.points_X = Eigen::Matrix3Xf::Zero(3, n);
  if (AnyLabel(solids_)) cloud.labels.assign(n, 0);
  std::mt19937 rng(seed);
  std::normal_distribution<double> gauss;
  size_t i = 0;
  for (uint32_t r = 0; r < lidar.rows; ++r) {
    const double elevation =
        lidar.elevation_max_rad -
        (r + 0.5) / lidar.rows * (lidar.elevation_max_rad - lidar.elevation_min_rad);
    for (uint32_t c = 0; c < lidar.columns; ++c, ++i) {
      const double azimuth = ((c + 0.5) / lidar.columns - 0.5) * lidar.azimuth_span_rad;
      const Vector3d ray_X(std::cos(elevation) * std::cos(azimuth),
                           std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const auto hit = Cast(T_W_X.translation(), T_W_X.linear() * ray_X);
      if (!hit || hit->t > lidar.max_range_m) continue;
      cloud.points_X.col(i) =
          (ray_X * (hit->t + (noise_m > 0 ? noise_m * gauss(rng) : 0.0))).cast<float>();
      if (!cloud.labels.empty()) cloud.labels[i] = hit->label;
    }
  }
  return cloud;
}

AnalyticScene AnalyticScene::Moved(const Pose& T_W_S) const {
  AnalyticScene moved = *this;
  for (Solid& s : moved.solids_) s.T_W_P = T_W_S * s.T_W_P;
  return moved;
}

}  // namespace clearance::testing
