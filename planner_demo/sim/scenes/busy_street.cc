#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/busy_traffic.h"
#include "planner_demo/sim/scenes/scenes.h"
#include "planner_demo/sim/scenes/street_town.h"
#include "planner_demo/sim/traffic.h"

namespace clearance::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kLane_m = 2.0;
constexpr double kVehiclesPerSecond = 0.5;
constexpr int kVehiclesAtFirst = 6;
constexpr int kPedestrians = 3;
constexpr double kMiddle_m = 10.0;  // where things happen

void AddVehicles(Random& random, double duration_s, Traffic& traffic) {
  const int wanted = kVehiclesAtFirst + static_cast<int>(kVehiclesPerSecond * duration_s);
  int added = 0;
  for (int attempt = 0; added < wanted && attempt < 2000; ++attempt) {
    const bool east = random.Index(2) == 0;
    const double kind = random.Uniform(0.0, 1.0);
    const double when_s = random.Uniform(-2.0, duration_s);
    Path path;
    path.start_W = {kMiddle_m, east ? -kLane_m : kLane_m, 0.0};
    path.start_heading_rad = east ? 0.0 : kPi;
    const Manner manner = kind < 0.25   ? Manner::kStopsAndStarts
                          : kind < 0.45 ? Manner::kSlowsDown
                                        : Manner::kSteady;
    path.speeds = DrawSpeeds(manner, random.Uniform(6.0, 11.0), when_s, random);
    path.start_offset_m = random.Uniform(-25.0, 15.0) - path.ArcLengthAt(when_s);
    const auto pose = [path](double time_s) { return path.PoseAt(time_s); };
    if (traffic.TryAdd(MakeVehicle(random), pose)) ++added;
  }
}

void AddPedestrians(Random& random, double duration_s, Traffic& traffic) {
  int added = 0;
  for (int attempt = 0; added < kPedestrians && attempt < 1000; ++attempt) {
    const bool east = random.Index(2) == 0;
    Path path;
    path.start_W = {random.Uniform(-10.0, 30.0),
                    (random.Index(2) == 0 ? 1.0 : -1.0) * random.Uniform(8.2, 8.9), 0.12};
    path.start_heading_rad = east ? 0.0 : kPi;
    path.speeds = DrawSpeeds(random.Index(3) == 0 ? Manner::kStopsAndStarts : Manner::kSteady,
                             random.Uniform(1.0, 1.6), random.Uniform(0.0, duration_s), random);
    const auto pose = [path](double time_s) { return path.PoseAt(time_s); };
    if (traffic.TryAdd(MakePedestrian(random), pose)) ++added;
  }
}

}  // namespace

Scene MakeBusyStreet(uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = "busy_street";
  scene.notes =
      "Traffic keeps coming both ways between parked cars, brakes, stops and starts; pedestrians "
      "walk. The lidar stands on the pavement.";
  scene.frame_count = frame_count > 0 ? frame_count : 200;
  scene.sensor = Lidar{48, 360, -22.5 * kPi / 180.0, 10.0 * kPi / 180.0, 50.0};
  const Eigen::Isometry3d eye = Upright({5.0, -8.0, 2.1}, 0.0);
  scene.T_W_X = [eye](double) { return eye; };
  AddStreetSurroundings(random, 60.0, scene);
  const double duration_s = (scene.frame_count + scene.future_frames) / scene.rate_hz;
  Traffic traffic(scene, duration_s, 0.4, 1.0);
  AddVehicles(random, duration_s, traffic);
  AddPedestrians(random, duration_s, traffic);
  return scene;
}

}  // namespace clearance::sim
