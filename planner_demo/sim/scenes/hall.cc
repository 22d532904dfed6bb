#include <cmath>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/scenes.h"
#include "planner_demo/sim/traffic.h"

namespace clearance::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kX = 22.0;  // half size of the hall
constexpr double kY = 15.0;
constexpr double kTop = 4.5;
constexpr int kWalkers = 12;

void AddHall(Random& random, Scene& scene) {
  auto& solids = scene.static_solids;
  constexpr double kWall = 0.3;
  solids.push_back(MakeBox({-kX - 1.0, -kY - 1.0, -1.0}, {kX + 1.0, kY + 1.0, 0.0}));
  solids.push_back(MakeBox({-kX - 1.0, -kY - 1.0, kTop}, {kX + 1.0, kY + 1.0, kTop + kWall}));
  for (const double side : {-1.0, 1.0}) {
    const double x = side * (kX + 0.5 * kWall);
    const double y = side * (kY + 0.5 * kWall);
    solids.push_back(
        MakeBox({x - 0.5 * kWall, -kY - kWall, 0.0}, {x + 0.5 * kWall, kY + kWall, kTop}));
    solids.push_back(MakeBox({-kX, y - 0.5 * kWall, 0.0}, {kX, y + 0.5 * kWall, kTop}));
  }
  for (const double x : {-14.0, -5.0, 5.0, 14.0}) {
    for (const double y : {-6.5, 6.5}) {
      solids.push_back(MakeUprightCylinder({x, y, 0.0}, random.Uniform(0.25, 0.45), kTop));
    }
  }
  for (int i = 0; i < 6; ++i) {  // counters along the walls
    const double x = random.Uniform(-kX + 3.0, kX - 3.0);
    const double y = (i % 2 ? 1.0 : -1.0) * (kY - random.Uniform(0.8, 1.5));
    solids.push_back(
        MakeBox({x - 1.2, y - 0.4, 0.0}, {x + 1.2, y + 0.4, random.Uniform(0.9, 2.2)}));
  }
}

// A wandering path: gentle bends to either side.
Path Wander(Random& random, double length_m) {
  Path path;
  path.start_W = {random.Uniform(-kX + 2.0, kX - 2.0), random.Uniform(-kY + 2.0, kY - 2.0), 0.0};
  path.start_heading_rad = random.Uniform(-kPi, kPi);
  for (double s = 0.0; s < length_m;) {
    path.stretches.push_back({random.Uniform(1.0, 4.0), random.Uniform(-0.5, 0.5)});
    s += path.stretches.back().length_m;
  }
  path.speeds = {{0.0, random.Uniform(0.6, 1.6)}};
  return path;
}

}  // namespace

Scene MakeHall(uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = "hall";
  scene.notes = "Lidar carried at 1.3 m. People are rigid.";
  scene.frame_count = frame_count > 0 ? frame_count : 80;
  scene.sensor = Lidar{64, 512, -22.5 * kPi / 180.0, 22.5 * kPi / 180.0, 20.0};
  AddHall(random, scene);
  const double phase = random.Uniform(0.0, 2.0 * kPi);
  scene.T_W_X = [phase](double time_s) -> Eigen::Isometry3d {
    // An ellipse between the pillars, with the sway of a walking person.
    const double angle = phase + 0.12 * time_s;
    const Eigen::Vector3d position_W(9.5 * std::cos(angle), 3.0 * std::sin(angle),
                                     1.3 + 0.02 * std::sin(10.0 * time_s));
    const double yaw = std::atan2(3.0 * std::cos(angle), -9.5 * std::sin(angle));
    return Upright(position_W, yaw) *
           Eigen::AngleAxisd(0.02 * std::sin(5.0 * time_s), Eigen::Vector3d::UnitX()) *
           Eigen::AngleAxisd(0.02 * std::cos(4.0 * time_s), Eigen::Vector3d::UnitY());
  };
  const double duration_s = (scene.frame_count + scene.future_frames) / scene.rate_hz;
  Traffic traffic(scene, duration_s, 0.25, 0.7);
  int added = 0;
  for (int attempt = 0; added < kWalkers && attempt < 20000; ++attempt) {
    const Path path = Wander(random, 1.7 * duration_s);
    if (traffic.TryAdd(MakePedestrian(random), [path](double t) { return path.PoseAt(t); }))
      ++added;
  }
  return scene;
}

}  // namespace clearance::sim
