#include <algorithm>
#include <cmath>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/scenes.h"
#include "planner_demo/sim/scenes/street_town.h"
#include "planner_demo/sim/traffic.h"

namespace clearance::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kLane = 2.0;
constexpr double kParking = 5.4;    // centre line of the parked cars
constexpr double kPavement = 6.6;   // its kerb
constexpr double kSideFrom = 22.0;  // the side street, on the left
constexpr double kSideTo = 34.0;

}  // namespace

void AddStreetSurroundings(Random& random, double end_m, Scene& scene) {
  auto& solids = scene.static_solids;
  const auto add = [&solids](const std::vector<Solid>& more) {
    solids.insert(solids.end(), more.begin(), more.end());
  };
  solids.push_back(MakeBox({-30.0, -40.0, -1.0}, {end_m, 40.0, 0.0}));
  for (const double side : {-1.0, 1.0}) {
    const auto opens = [side](double from, double to) {
      return side > 0.0 && from < kSideTo && to > kSideFrom;
    };
    const auto block = [side](double x0, double x1, double near, double far, double z0, double z1) {
      return side > 0.0 ? MakeBox({x0, near, z0}, {x1, far, z1})
                        : MakeBox({x0, -far, z0}, {x1, -near, z1});
    };
    if (side > 0.0) {
      solids.push_back(block(-30.0, kSideFrom, kPavement, 39.0, -0.5, 0.12));
      solids.push_back(block(kSideTo, end_m, kPavement, 39.0, -0.5, 0.12));
    } else {
      solids.push_back(block(-30.0, end_m, kPavement, 39.0, -0.5, 0.12));
    }
    for (double from = -28.0; from < end_m - 12.0;) {
      const double to = from + random.Uniform(7.0, 14.0);
      const double front = random.Uniform(9.5, 11.0);
      if (!opens(from, to)) {
        solids.push_back(block(from, to, front, front + 9.0, 0.0, random.Uniform(6.0, 13.0)));
        const double door = 0.5 * (from + to);
        solids.push_back(block(door - 0.6, door + 0.6, front - 0.25, front + 0.2, 0.0, 2.4));
      }
      from = to + (random.Uniform(0.0, 1.0) < 0.3 ? random.Uniform(1.0, 3.0) : 0.0);
    }
    for (double x = -20.0; x < end_m - 5.0; x += random.Uniform(11.0, 17.0)) {
      if (opens(x - 2.0, x + 2.0)) continue;
      add(MakeLamp({x, side * 7.2, 0.12}));
      if (random.Uniform(0.0, 1.0) < 0.5) add(MakeTree({x + 5.0, side * 7.6, 0.12}, random));
    }
    for (double x = -15.0; x < end_m - 10.0; x += random.Uniform(5.6, 9.0)) {
      if (opens(x - 4.0, x + 4.0) || random.Uniform(0.0, 1.0) < 0.35) continue;
      add(Placed(MakeCar(random).solids,
                 Upright({x, side * kParking, 0.0}, side > 0.0 ? kPi : 0.0)));
    }
  }
}

namespace {

Path Straight(double x, double lane, double heading_rad, double speed_mps) {
  Path path;
  path.start_W = {x, lane, 0.0};
  path.start_heading_rad = heading_rad;
  path.speeds = {{0.0, speed_mps}};
  return path;
}

void AddVehicles(Random& random, Traffic& traffic) {
  const auto add = [&](Body body, const Path& path) {
    return traffic.TryAdd(std::move(body), [path](double time_s) { return path.PoseAt(time_s); });
  };
  // One drives ahead, one comes out of the side street to the right, the rest are oncoming.
  add(MakeVan(random), Straight(random.Uniform(10.0, 13.0), -kLane, 0.0, random.Uniform(5.8, 6.2)));
  for (int attempt = 0; attempt < 200; ++attempt) {
    const double radius = 5.0;
    Path path;
    path.start_W = {0.5 * (kSideFrom + kSideTo) - kLane, random.Uniform(13.0, 18.0), 0.0};
    path.start_heading_rad = -kPi / 2.0;
    path.stretches = {{path.start_W.y() - kLane - radius, 0.0},
                      {radius * kPi / 2.0, -1.0 / radius}};
    path.speeds = {{0.0, random.Uniform(4.5, 6.0)}};
    if (add(MakeVan(random), path)) break;
  }
  int oncoming = 0;
  for (int attempt = 0; oncoming < 3 && attempt < 2000; ++attempt) {
    const double x = random.Uniform(18.0, 60.0 + attempt * 0.05);
    if (add(MakeCar(random), Straight(x, kLane, kPi, random.Uniform(5.0, 7.0)))) ++oncoming;
  }
}

}  // namespace

Scene MakeStreet(uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = "street";
  scene.notes =
      "One vehicle drives ahead, one turns out of a side street, the others come towards "
      "the camera on the left. Parked cars are static.";
  scene.frame_count = frame_count > 0 ? frame_count : 60;
  scene.voxel_size_m = 0.1;
  scene.sensor = DepthCamera::WithHorizontalView(1280, 720, kPi / 2.0, 5e-4, 25.0);
  constexpr double kSpeed = 6.0;
  const double sway = random.Uniform(0.0, 2.0 * kPi);
  scene.T_W_X = [sway](double time_s) {
    const double x = kSpeed * time_s;
    const Eigen::Vector3d eye(x, -1.65 + 0.02 * std::sin(0.7 * time_s + sway),
                              1.55 + 0.015 * std::sin(2.3 * time_s + sway));
    return LookAt(eye, eye + Eigen::Vector3d(10.0, 0.15 * std::sin(0.9 * time_s + sway), -0.25));
  };
  const double duration_s = (scene.frame_count + scene.future_frames) / scene.rate_hz;
  AddStreetSurroundings(random, std::max(146.0, kSpeed * duration_s + 60.0), scene);
  Traffic traffic(scene, duration_s, 0.3, 1.0);
  AddVehicles(random, traffic);
  return scene;
}

}  // namespace clearance::sim
