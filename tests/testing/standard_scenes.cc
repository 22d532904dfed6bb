// The scenes that accuracy is stated on, and poses to see them from.
#include <cmath>
#include <random>

#include "tests/testing/analytic_scene.h"

namespace clearance::testing {
namespace {

using Eigen::AngleAxisd;
using Eigen::Vector3d;

Pose At(double x, double y, double z) { return Pose(Eigen::Translation3d(x, y, z)); }

Solid HalfSpace(const Vector3d& point, const Vector3d& normal) {
  Solid s;
  s.kind = Solid::Kind::kHalfSpace;
  s.T_W_P =
      Eigen::Translation3d(point) * Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), normal);
  return s;
}

// `count` cameras on a circle around `target`.
std::vector<Pose> Around(const Vector3d& target, double radius_m, double height_m, int count,
                         double from_rad = 0, double span_rad = 2 * M_PI) {
  std::vector<Pose> views;
  for (int i = 0; i < count; ++i) {
    const double a = from_rad + span_rad * i / count;
    views.push_back(LookAt(
        target + Vector3d(radius_m * std::cos(a), radius_m * std::sin(a), height_m), target));
  }
  return views;
}

}  // namespace

Intrinsics Intrinsics::Small() { return {}; }

Intrinsics Intrinsics::Large() {
  Intrinsics k;
  k.width = 1280;
  k.height = 720;
  k.fx = k.fy = 640;
  k.cx = 639.5;
  k.cy = 359.5;
  return k;
}

Pose LookAt(const Vector3d& eye, const Vector3d& target, const Vector3d& up) {
  const Vector3d z = (target - eye).normalized();
  const Vector3d x = z.cross(up).normalized();
  Pose T_W_X = Pose::Identity();
  T_W_X.linear() << x, z.cross(x), z;
  T_W_X.translation() = eye;
  return T_W_X;
}

Pose LidarFromCamera(const Pose& T_W_camera) {
  Eigen::Matrix3d R_camera_lidar;  // columns: lidar x forward, y left, z up in camera axes
  R_camera_lidar << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  Pose T = T_W_camera;
  T.linear() = T_W_camera.linear() * R_camera_lidar;
  return T;
}

Pose RandomPose(uint32_t seed, double extent_m) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> gauss;
  std::uniform_real_distribution<double> uniform(-extent_m, extent_m);
  const double w = gauss(rng), x = gauss(rng), y = gauss(rng), z = gauss(rng);
  Pose T = Pose::Identity();
  T.linear() = Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
  const double tx = uniform(rng), ty = uniform(rng), tz = uniform(rng);
  T.translation() = Vector3d(tx, ty, tz);
  return T;
}

ViewedScene ViewedScene::Moved(const Pose& T_W_S) const {
  ViewedScene moved{scene.Moved(T_W_S), views};
  for (Pose& T_W_X : moved.views) T_W_X = T_W_S * T_W_X;
  return moved;
}

ViewedScene PlaneScene() {
  const Vector3d normal = Vector3d(-1, 0.3, 0.2).normalized();
  ViewedScene v{AnalyticScene("plane", {HalfSpace({3, 0, 0}, normal)}), {}};
  for (int i = 0; i < 8; ++i) {
    v.views.push_back(
        LookAt({0.1 * i - 0.4, 0.35 * i - 1.2, 0.15 * i - 0.5}, {3, 0.2 * i - 0.8, 0}));
  }
  return v;
}

ViewedScene BoxScene() {
  Solid box;
  box.kind = Solid::Kind::kBox;
  box.size = {2.0, 1.2, 1.5};
  box.T_W_P = At(0, 0, 0.75) * AngleAxisd(0.4, Vector3d::UnitZ());
  ViewedScene v{AnalyticScene("box", {HalfSpace({0, 0, 0}, Vector3d::UnitZ()), box}), {}};
  v.views = Around({0, 0, 0.7}, 3.5, 1.6, 12);
  return v;
}

ViewedScene SphereScene() {
  Solid sphere;
  sphere.kind = Solid::Kind::kSphere;
  sphere.size = {1.0, 0, 0};
  sphere.T_W_P = At(0.03, -0.02, 1.5);
  ViewedScene v{AnalyticScene("sphere", {HalfSpace({0, 0, 0}, Vector3d::UnitZ()), sphere}), {}};
  v.views = Around({0, 0, 1.4}, 3.5, 1.0, 12);
  return v;
}

ViewedScene CornerScene() {
  ViewedScene v{
      AnalyticScene("corner", {HalfSpace({0, 0, 0}, Vector3d::UnitZ()),
                               HalfSpace({3, 0, 0}, Vector3d(-1, 0.2, 0).normalized()),
                               HalfSpace({0, 2.5, 0}, Vector3d(0.1, -1, 0).normalized())}),
      {}};
  for (int i = 0; i < 10; ++i) {
    v.views.push_back(LookAt({0.1 * i - 1.5, -1.8 + 0.3 * i, 1.0 + 0.05 * i}, {2.6, 2.2, 0.6}));
  }
  return v;
}

ViewedScene PoleScene() {
  Solid pole;
  pole.kind = Solid::Kind::kCylinder;
  pole.size = {0.04, 0, 2.4};
  pole.T_W_P = At(0.013, 0.027, 1.2);
  ViewedScene v{AnalyticScene("pole", {HalfSpace({0, 0, 0}, Vector3d::UnitZ()),
                                       HalfSpace({4, 0, 0}, -Vector3d::UnitX()), pole}),
                {}};
  v.views = Around({0, 0, 1.0}, 2.5, 0.4, 12);
  return v;
}

std::vector<ViewedScene> StandardScenes() {
  return {PlaneScene(), BoxScene(), SphereScene(), CornerScene(), PoleScene()};
}

}  // namespace clearance::testing
