// Scenes with a closed-form distance, and sensors that see them exactly: independent truth for
// tests.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/core/frame.h"
#include "server/core/pose.h"

namespace clearance::testing {

struct Intrinsics {
  uint32_t width = 320, height = 180;
  double fx = 160, fy = 160, cx = 159.5, cy = 89.5;
  double depth_scale_m = 0.0005;
  double max_range_m = 25.0;

  static Intrinsics Small();  // 320 x 180, 90 degrees
  static Intrinsics Large();  // 1280 x 720, 90 degrees
};

// A spinning lidar: x forward, y left, z up; `rows` beams from `elevation_max_rad` down, `columns`
// over azimuths from -azimuth_span_rad / 2 on (the row-by-row order of organised clouds).
struct LidarModel {
  uint32_t rows = 64, columns = 512;
  double elevation_min_rad = -0.43, elevation_max_rad = 0.26;
  double azimuth_span_rad = 2 * 3.14159265358979323846;
  double max_range_m = 40.0;
};

// One convex solid in its own frame P. kHalfSpace: z < 0. kBox: |x|, |y|, |z| <= size / 2.
// kSphere: radius size.x. kCylinder: axis z, radius size.x, height size.z, centred.
struct Solid {
  enum class Kind { kHalfSpace, kBox, kSphere, kCylinder };
  Kind kind = Kind::kBox;
  Pose T_W_P = Pose::Identity();
  Eigen::Vector3d size = Eigen::Vector3d::Ones();
  uint16_t label = 0;

  // Signed distance (> 0 outside), exact on both sides, and its unit gradient.
  double Distance(const Eigen::Vector3d& p_W) const;
  Eigen::Vector3d Gradient(const Eigen::Vector3d& p_W) const;
  // Smallest t > 0 with origin + t * direction on the surface, from outside.
  std::optional<double> Cast(const Eigen::Vector3d& origin_W,
                             const Eigen::Vector3d& direction_W) const;
};

// A union of solids. Outside every solid the distance is exact; inside overlapping solids it is a
// lower bound of the depth.
class AnalyticScene {
 public:
  AnalyticScene() = default;
  AnalyticScene(std::string name, std::vector<Solid> solids)
      : name_(std::move(name)), solids_(std::move(solids)) {}

  const std::string& name() const { return name_; }
  const std::vector<Solid>& solids() const { return solids_; }
  std::vector<Solid>& solids() { return solids_; }

  double Distance(const Eigen::Vector3d& p_W) const;
  Eigen::Vector3d Gradient(const Eigen::Vector3d& p_W) const;
  // The nearest surface point of a point outside.
  Eigen::Vector3d NearestSurface(const Eigen::Vector3d& p_W) const;

  struct Hit {
    double t = 0;  // multiples of the direction
    uint16_t label = 0;
  };
  std::optional<Hit> Cast(const Eigen::Vector3d& origin_W,
                          const Eigen::Vector3d& direction_W) const;

  // Depth image from T_W_X (x right, y down, z forward) with Gaussian noise of `noise_m` along z.
  // Labels are present when any solid has one.
  DepthImage RenderDepth(const Pose& T_W_X, const Intrinsics& intrinsics, double noise_m = 0,
                         uint32_t seed = 0) const;
  // Organised cloud from T_W_X (x forward, y left, z up) with noise along the ray.
  PointCloud RenderLidar(const Pose& T_W_X, const LidarModel& lidar, double noise_m = 0,
                         uint32_t seed = 0) const;

  // The same scene moved rigidly by T_W_S.
  AnalyticScene Moved(const Pose& T_W_S) const;

 private:
  std::string name_;
  std::vector<Solid> solids_;
};

// A scene with camera poses that see it from several sides.
struct ViewedScene {
  AnalyticScene scene;
  std::vector<Pose> views;  // T_W_X, camera convention

  ViewedScene Moved(const Pose& T_W_S) const;
};

// T_W_X of a camera at `eye` that looks at `target`, image y pointing along -up as far as it can.
Pose LookAt(const Eigen::Vector3d& eye, const Eigen::Vector3d& target,
            const Eigen::Vector3d& up = Eigen::Vector3d::UnitZ());
// T_W_X of a lidar (z up) at a camera's pose.
Pose LidarFromCamera(const Pose& T_W_camera);
// A pose drawn from `seed`: any rotation, translation uniform within +-extent_m.
Pose RandomPose(uint32_t seed, double extent_m);

ViewedScene PlaneScene();   // a tilted wall seen from 8 places
ViewedScene BoxScene();     // a 2 x 1.2 x 1.5 m box on the floor, seen from all around
ViewedScene SphereScene();  // a sphere of radius 1 m over a floor, seen from all around
ViewedScene CornerScene();  // floor and two walls meeting in a concave corner
ViewedScene PoleScene();    // a pole of 8 cm diameter before a wall, seen from several sides
std::vector<ViewedScene> StandardScenes();

}  // namespace clearance::testing
