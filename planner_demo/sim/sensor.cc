#include "planner_demo/sim/sensor.h"

#include <cmath>
#include <numbers>

namespace clearance::sim {

DepthCamera DepthCamera::WithHorizontalView(int width, int height, double horizontal_view_rad,
                                            double depth_scale_m, double max_range_m) {
  const double focal = 0.5 * width / std::tan(0.5 * horizontal_view_rad);
  return {width,         height,     focal, focal, 0.5 * (width - 1), 0.5 * (height - 1),
          depth_scale_m, max_range_m};
}

int Rows(const Sensor& sensor) {
  const auto* camera = std::get_if<DepthCamera>(&sensor);
  return camera ? camera->height : std::get<Lidar>(sensor).beams;
}

int Columns(const Sensor& sensor) {
  const auto* camera = std::get_if<DepthCamera>(&sensor);
  return camera ? camera->width : std::get<Lidar>(sensor).columns;
}

double MaxRange(const Sensor& sensor) {
  return std::visit([](const auto& s) { return s.max_range_m; }, sensor);
}

std::vector<Eigen::Vector3d> RayDirections(const Sensor& sensor) {
  std::vector<Eigen::Vector3d> directions_X;
  directions_X.reserve(static_cast<size_t>(Rows(sensor)) * Columns(sensor));
  for (int row = 0; row < Rows(sensor); ++row) {
    for (int column = 0; column < Columns(sensor); ++column) {
      if (const auto* camera = std::get_if<DepthCamera>(&sensor)) {
        directions_X.emplace_back((column - camera->cx) / camera->fx,
                                  (row - camera->cy) / camera->fy, 1.0);
        continue;
      }
      const Lidar& lidar = std::get<Lidar>(sensor);
      const double share = lidar.beams > 1 ? static_cast<double>(row) / (lidar.beams - 1) : 0.5;
      const double elevation =
          lidar.elevation_max_rad + share * (lidar.elevation_min_rad - lidar.elevation_max_rad);
      const double azimuth = std::numbers::pi * (1.0 - 2.0 * column / lidar.columns);
      directions_X.emplace_back(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
    }
  }
  return directions_X;
}

Scan CastScan(const RayCaster& scene, const Sensor& sensor,
              const std::vector<Eigen::Vector3d>& directions_X, const Eigen::Isometry3d& T_W_X) {
  Scan scan{Rows(sensor), Columns(sensor), std::vector<double>(directions_X.size(), 0.0),
            std::vector<uint16_t>(directions_X.size(), 0)};
  const Eigen::Vector3d origin_W = T_W_X.translation();
  const double max_range_m = MaxRange(sensor);
  int hint = -1;
  for (size_t i = 0; i < directions_X.size(); ++i) {
    const RayCaster::Hit hit =
        scene.Cast(origin_W, T_W_X.linear() * directions_X[i], max_range_m, hint);
    hint = hit.solid;
    if (hit.solid < 0) continue;
    scan.ranges_m[i] = hit.t;
    scan.labels[i] = hit.owner;
  }
  return scan;
}

}  // namespace clearance::sim
