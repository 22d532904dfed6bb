#include "planner_demo/sim/bodies.h"

#include <numbers>

namespace clearance::sim {
namespace {

// A disc that stands on the ground and rolls along x.
Solid Wheel(double x, double y, double radius_m, double half_width_m) {
  Solid wheel{Cylinder{radius_m, half_width_m}, Eigen::Isometry3d::Identity()};
  wheel.T_B_S.linear() =
      Eigen::AngleAxisd(std::numbers::pi / 2.0, Eigen::Vector3d::UnitX()).toRotationMatrix();
  wheel.T_B_S.translation() = Eigen::Vector3d(x, y, radius_m);
  return wheel;
}

void AddWheels(double axle_front_m, double axle_rear_m, double half_width_m, double radius_m,
               std::vector<Solid>& solids) {
  constexpr double kHalfTyreWidth = 0.11;
  constexpr double kProud = 0.02;  // beyond the body's side
  for (const double x : {axle_front_m, axle_rear_m}) {
    for (const double side : {-1.0, 1.0}) {
      solids.push_back(
          Wheel(x, side * (half_width_m + kProud - kHalfTyreWidth), radius_m, kHalfTyreWidth));
    }
  }
}

Solid Prism(const std::vector<Eigen::Vector2d>& profile_xz_m, double half_width_m, double taper) {
  return {MakePrism(profile_xz_m, half_width_m, taper), Eigen::Isometry3d::Identity()};
}

Solid Limb(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius_m) {
  Solid limb{Capsule{radius_m, 0.5 * (to - from).norm()}, Eigen::Isometry3d::Identity()};
  limb.T_B_S.linear() =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), to - from).toRotationMatrix();
  limb.T_B_S.translation() = 0.5 * (from + to);
  return limb;
}

}  // namespace

Body MakeCar(Random& random) {
  const double l = random.Uniform(1.9, 2.35);   // half length
  const double w = random.Uniform(0.86, 0.95);  // half width
  const double waist = random.Uniform(0.82, 0.92);
  const double roof = random.Uniform(1.42, 1.52);
  Body body{"Car", {}, l, w + 0.02};
  body.solids.push_back(Prism({{-l + 0.1, 0.22},
                               {l - 0.12, 0.22},
                               {l, 0.42},
                               {l - 0.05, 0.66},
                               {l - 0.35, waist - 0.06},
                               {-l + 0.15, waist},
                               {-l, 0.6}},
                              w, 0.95));
  const double front = random.Uniform(0.75, 1.0);
  const double rear = -l + random.Uniform(0.25, 0.6);
  body.solids.push_back(Prism(
      {{rear, waist - 0.08}, {front, waist - 0.08}, {front - 0.65, roof}, {rear + 0.45, roof}},
      0.94 * w, 0.8));
  AddWheels(l - 0.85, -l + 0.8, w, 0.32, body.solids);
  return body;
}

Body MakeVan(Random& random) {
  const double l = random.Uniform(2.4, 2.7);
  const double w = random.Uniform(0.95, 1.05);
  const double roof = random.Uniform(2.0, 2.3);
  Body body{"Van", {}, l, w + 0.02};
  body.solids.push_back(Prism({{-l, 0.25},
                               {l - 0.1, 0.25},
                               {l, 0.5},
                               {l - 0.05, 1.0},
                               {l - 0.85, roof - 0.05},
                               {l - 1.2, roof},
                               {-l, roof}},
                              w, 0.93));
  AddWheels(l - 0.95, -l + 0.95, w, 0.34, body.solids);
  return body;
}

Body MakeTruck(Random& random) {
  const double l = random.Uniform(3.4, 3.9);
  const double w = random.Uniform(1.1, 1.2);
  const double roof = random.Uniform(2.8, 3.2);
  Body body{"Truck", {}, l, w + 0.02};
  body.solids.push_back(MakeBox({-l, -w, 0.75}, {l - 2.0, w, roof}));
  body.solids.push_back(Prism(
      {{l - 1.9, 0.4}, {l, 0.4}, {l, 1.4}, {l - 0.35, 2.35}, {l - 1.9, 2.35}}, w - 0.05, 0.95));
  body.solids.push_back(MakeBox({-l + 0.3, -0.5, 0.45}, {l - 1.9, 0.5, 0.75}));
  AddWheels(l - 1.0, -l + 1.3, w - 0.1, 0.45, body.solids);
  return body;
}

Body MakeCyclist(Random& random) {
  const double height = random.Uniform(1.65, 1.8);
  Body body{"Cyclist", {}, 0.9, 0.3};
  for (const double x : {-0.52, 0.52}) body.solids.push_back(Wheel(x, 0.0, 0.34, 0.025));
  body.solids.push_back(Limb({-0.5, 0.0, 0.34}, {0.45, 0.0, 0.9}, 0.03));
  body.solids.push_back(Limb({-0.15, 0.0, 1.0}, {0.2, 0.0, height - 0.35}, 0.18));
  body.solids.push_back(MakeSphere({0.28, 0.0, height - 0.12}, 0.12));
  for (const double side : {-1.0, 1.0}) {
    body.solids.push_back(Limb({-0.12, 0.1 * side, 0.95}, {0.05, 0.12 * side, 0.35}, 0.08));
    body.solids.push_back(Limb({0.2, 0.17 * side, height - 0.4}, {0.45, 0.22 * side, 1.0}, 0.05));
  }
  return body;
}

Body MakePedestrian(Random& random) {
  const double height = random.Uniform(1.6, 1.9);
  const double hip = 0.5 * height;
  const double shoulder = 0.82 * height;
  Body body{"Pedestrian", {}, 0.3, 0.3};
  body.solids.push_back(Limb({0.0, 0.0, hip + 0.05}, {0.0, 0.0, shoulder - 0.1}, 0.18));
  body.solids.push_back(MakeSphere({0.0, 0.0, height - 0.12}, 0.12));
  for (const double side : {-1.0, 1.0}) {
    body.solids.push_back(Limb({0.0, 0.1 * side, hip}, {0.12 * side, 0.1 * side, 0.085}, 0.08));
    body.solids.push_back(
        Limb({0.0, 0.2 * side, shoulder - 0.08}, {-0.1 * side, 0.23 * side, hip}, 0.05));
  }
  return body;
}

Body MakeVehicle(Random& random) {
  const double kind = random.Uniform(0.0, 1.0);
  if (kind < 0.65) return MakeCar(random);
  return kind < 0.9 ? MakeVan(random) : MakeTruck(random);
}

std::vector<Solid> MakeTree(const Eigen::Vector3d& foot_W, Random& random) {
  const double height = random.Uniform(2.4, 3.2);
  const double crown = random.Uniform(1.1, 1.6);
  return {MakeUprightCylinder(foot_W, random.Uniform(0.12, 0.2), height + 0.3),
          MakeSphere(foot_W + Eigen::Vector3d(0.0, 0.0, height + 0.8 * crown), crown)};
}

std::vector<Solid> MakeLamp(const Eigen::Vector3d& foot_W) {
  return {MakeUprightCylinder(foot_W, 0.07, 5.5)};
}

std::vector<Solid> Placed(const std::vector<Solid>& solids, const Eigen::Isometry3d& T_W_B) {
  std::vector<Solid> placed = solids;
  for (Solid& solid : placed) solid.T_B_S = T_W_B * solid.T_B_S;
  return placed;
}

}  // namespace clearance::sim
