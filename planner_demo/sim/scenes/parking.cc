#include <cmath>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace clearance::sim {
namespace {

Path Along(double x, double y, double heading_rad, std::vector<Path::SpeedKnot> speeds) {
  Path path;
  path.start_W = {x, y, 0.0};
  path.start_heading_rad = heading_rad;
  path.speeds = std::move(speeds);
  return path;
}

}  // namespace

Scene MakeParking(uint64_t seed, int frame_count) {
  constexpr double kPi = std::numbers::pi;
  Random random(seed);
  Scene scene;
  scene.name = "parking";
  scene.notes =
      "One car parks, one that stood drives off, one stops and goes on; the lidar stands aside.";
  scene.frame_count = frame_count > 0 ? frame_count : 80;
  scene.future_frames = 30;
  scene.sensor = Lidar{64, 512, -22.5 * kPi / 180.0, 22.5 * kPi / 180.0, 30.0};
  const Eigen::Isometry3d eye = Upright({0.0, -7.0, 1.6}, 0.5 * kPi + random.Uniform(-0.3, 0.3));
  scene.T_W_X = [eye](double) { return eye; };

  auto& solids = scene.static_solids;
  solids.push_back(MakeBox({-60.0, -40.0, -1.0}, {60.0, 40.0, 0.0}));
  solids.push_back(MakeBox({-50.0, 9.0, 0.0}, {50.0, 12.0, random.Uniform(3.0, 6.0)}));
  for (double x = -20.0; x <= 20.0; x += random.Uniform(6.0, 9.0)) {
    const auto tree = MakeTree({x, 7.5, 0.0}, random);
    solids.insert(solids.end(), tree.begin(), tree.end());
  }

  // Times by the recording's length, so that short ones show all of it, too.
  const double end_s = scene.frame_count / scene.rate_hz;
  const auto add = [&](const Path& path) {
    Body body = MakeCar(random);
    scene.movers.push_back({static_cast<uint16_t>(scene.movers.size() + 1), body.class_name,
                            std::move(body.solids),
                            [path](double time_s) { return path.PoseAt(time_s); }});
  };
  const double speed = random.Uniform(3.0, 4.0);
  add(Along(-9.0 - random.Uniform(0.0, 2.0), -1.5, 0.0,
            {{0.3 * end_s, speed}, {0.55 * end_s, 0.0}}));
  add(Along(random.Uniform(1.0, 3.0), 2.0, kPi, {{0.35 * end_s, 0.0}, {0.6 * end_s, speed}}));
  add(Along(
      12.0 + random.Uniform(0.0, 2.0), 5.0, kPi,
      {{0.2 * end_s, speed}, {0.35 * end_s, 0.0}, {0.55 * end_s, 0.0}, {0.7 * end_s, speed}}));
  return scene;
}

}  // namespace clearance::sim
