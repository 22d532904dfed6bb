#include <cmath>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::sim {

Scene MakeOrbit(uint64_t seed, int frame_count) {
  constexpr double kPi = std::numbers::pi;
  Random random(seed);
  Scene scene;
  scene.name = "orbit";
  scene.notes = "One car seen from all sides, from just above the road to above its roof.";
  scene.frame_count = frame_count > 0 ? frame_count : 200;
  scene.voxel_size_m = 0.1;
  scene.sensor = DepthCamera::WithHorizontalView(1280, 720, 80.0 * kPi / 180.0, 5e-4, 25.0);

  Path path;
  path.start_W = {0.0, 0.0, 0.0};
  path.stretches = {{12.0, 0.0}, {1000.0, 1.0 / 35.0}};
  path.speeds = {{0.0, random.Uniform(3.5, 4.5)}};
  const Body car = MakeCar(random);
  const PoseFunction T_W_L = [path](double time_s) { return path.PoseAt(time_s); };
  scene.movers.push_back({1, car.class_name, car.solids, T_W_L});

  // One turn around the car in 10 s, rising and sinking.
  const double radius_m = random.Uniform(5.5, 6.5);
  const double begin_rad = random.Uniform(-kPi, kPi);
  scene.T_W_X = [=](double time_s) {
    const Eigen::Vector3d target_W = T_W_L(time_s) * Eigen::Vector3d(0.0, 0.0, 0.7);
    const double angle = begin_rad + 2.0 * kPi * time_s / 10.0;
    const double height = 1.8 - 1.1 * std::cos(2.0 * kPi * time_s / 20.0);
    return LookAt({target_W.x() + radius_m * std::cos(angle),
                   target_W.y() + radius_m * std::sin(angle), height},
                  target_W);
  };

  auto& solids = scene.static_solids;
  solids.push_back(MakeBox({-40.0, -40.0, -1.0}, {100.0, 90.0, 0.0}));
  // Buildings and trees around the road, out of the camera's way.
  for (int i = 0; i < 40; ++i) {
    const double s = random.Uniform(-20.0, 110.0);
    const Eigen::Isometry3d T = path.PoseAtArcLength(s);
    const double side = random.Uniform(0.0, 1.0) < 0.5 ? -1.0 : 1.0;
    const Eigen::Vector3d foot = T * Eigen::Vector3d(0.0, side * random.Uniform(13.0, 17.0), 0.0);
    // On the inner side of the bend the road may come near again.
    double nearest_m = 1e9;
    for (double at = -25.0; at < 120.0; at += 1.0) {
      nearest_m = std::min(nearest_m, (path.PoseAtArcLength(at).translation() - foot).norm());
    }
    if (nearest_m < 12.5) continue;
    if (i % 2 == 0) {
      const auto tree = MakeTree(foot, random);
      solids.insert(solids.end(), tree.begin(), tree.end());
    } else {
      const double half = random.Uniform(1.5, 2.5);
      const double height = random.Uniform(3.0, 9.0);
      solids.push_back(MakeBox({foot.x() - half, foot.y() - half, 0.0},
                               {foot.x() + half, foot.y() + half, height}));
    }
  }
  return scene;
}

}  // namespace clearance::sim
