#include <cmath>
#include <numbers>

#include "planner_demo/sim/random.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::sim {
namespace {

// A cube on a rope (not modelled) that swings like a pendulum and turns freely.
PoseFunction Swinging(const Eigen::Vector3d& pivot_W, Random& random) {
  constexpr double kGravity = 9.81;
  const double rope_m = random.Uniform(1.1, 1.5);
  const double reach_x = random.Uniform(0.1, 0.25);  // amplitudes, radians
  const double reach_y = random.Uniform(0.1, 0.25);
  const double phase_x = random.Uniform(0.0, 2.0 * std::numbers::pi);
  const double phase_y = random.Uniform(0.0, 2.0 * std::numbers::pi);
  const double rate = std::sqrt(kGravity / rope_m);
  Eigen::Vector3d axis(random.Normal(1.0), random.Normal(1.0), random.Normal(1.0));
  axis.normalize();
  const double spin_radps = random.Uniform(0.5, 1.5);
  return [=](double time_s) {
    const double ax = reach_x * std::sin(rate * time_s + phase_x);
    const double ay = reach_y * std::sin(rate * time_s + phase_y);
    Eigen::Isometry3d T_W_L = Eigen::Isometry3d::Identity();
    T_W_L.linear() = Eigen::AngleAxisd(spin_radps * time_s, axis).toRotationMatrix();
    T_W_L.translation() =
        pivot_W + rope_m * Eigen::Vector3d(std::sin(ax), std::sin(ay) * std::cos(ax),
                                           -std::cos(ax) * std::cos(ay));
    return T_W_L;
  };
}

}  // namespace

Scene MakeCubes(uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = "cubes";
  scene.notes = "Four 0.3 m cubes, ropes not modelled.";
  scene.frame_count = frame_count > 0 ? frame_count : 150;
  scene.future_frames = 90;
  scene.rate_hz = 30.0;
  scene.voxel_size_m = 0.05;
  scene.sensor =
      DepthCamera::WithHorizontalView(640, 480, 64.0 * std::numbers::pi / 180.0, 2e-4, 8.0);
  auto& solids = scene.static_solids;
  constexpr double kX = 4.1;
  constexpr double kY = 3.8;
  constexpr double kTop = 2.8;
  constexpr double kWall = 0.15;
  solids.push_back(MakeBox({-kX - kWall, -kY - kWall, -1.0}, {kX + kWall, kY + kWall, 0.0}));
  solids.push_back(
      MakeBox({-kX - kWall, -kY - kWall, kTop}, {kX + kWall, kY + kWall, kTop + kWall}));
  for (const double side : {-1.0, 1.0}) {
    const double x = side * (kX + 0.5 * kWall);
    const double y = side * (kY + 0.5 * kWall);
    solids.push_back(MakeBox({x - 0.5 * kWall, -kY, 0.0}, {x + 0.5 * kWall, kY, kTop}));
    solids.push_back(MakeBox({-kX, y - 0.5 * kWall, 0.0}, {kX, y + 0.5 * kWall, kTop}));
  }
  solids.push_back(MakeBox({2.6, -1.2, 0.0}, {3.4, 0.6, 0.75}));
  solids.push_back(MakeBox({3.5, 1.6, 0.0}, {4.1, 3.2, 2.0}));
  solids.push_back(MakeUprightCylinder({1.8, -3.0, 0.0}, 0.3, 1.1));
  solids.push_back(MakeSphere({3.0, -0.5, 1.0}, 0.25));

  uint16_t id = 0;
  for (const double x : {0.0, 1.4}) {
    for (const double y : {-0.75, 0.75}) {
      const Eigen::Vector3d pivot_W(x + random.Uniform(-0.05, 0.05),
                                    y + random.Uniform(-0.05, 0.05), 2.7);
      scene.movers.push_back({++id,
                              "Cube",
                              {MakeBox({-0.15, -0.15, -0.15}, {0.15, 0.15, 0.15})},
                              Swinging(pivot_W, random)});
    }
  }
  const double phase = random.Uniform(0.0, 2.0 * std::numbers::pi);
  scene.T_W_X = [phase](double time_s) {
    const double angle = 0.5 * std::sin(0.6 * time_s + phase);
    return LookAt(
        {0.7 - 3.0 * std::cos(angle), 3.0 * std::sin(angle), 1.35 + 0.2 * std::sin(0.9 * time_s)},
        {0.7, 0.0, 1.25});
  };
  return scene;
}

}  // namespace clearance::sim
