#include <cmath>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/busy_traffic.h"
#include "planner_demo/sim/scenes/crossing_town.h"
#include "planner_demo/sim/scenes/scenes.h"
#include "planner_demo/sim/traffic.h"

namespace clearance::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kVehiclesPerSecond = 0.75;  // about ten within 60 m at any time
constexpr int kVehiclesAtFirst = 8;
constexpr int kPedestrians = 4;

void AddVehicles(Random& random, double duration_s, Traffic& traffic) {
  const int wanted = kVehiclesAtFirst + static_cast<int>(kVehiclesPerSecond * duration_s);
  int added = 0;
  for (int attempt = 0; added < wanted && attempt < 3000; ++attempt) {
    const double kind = random.Uniform(0.0, 1.0);
    const int approach = random.Index(4);
    const double speed_mps = random.Uniform(7.0, 12.0);
    const double when_s = random.Uniform(-2.0, duration_s);
    Path path;
    const Eigen::Isometry3d T = QuarterTurns(approach);
    path.start_W = T * Eigen::Vector3d(-kApproach_m, -kLane_m, 0.0);
    path.start_heading_rad = approach * kPi / 2.0;
    if (kind < 0.35) {
      const int turn = random.Index(2) == 0 ? -1 : 1;
      const double radius_m = turn > 0 ? 8.0 : 5.0;
      const double begins_m = turn > 0 ? kLane_m - radius_m : -kLane_m - radius_m;
      path.stretches = {{kApproach_m + begins_m, 0.0}, {radius_m * kPi / 2.0, turn / radius_m}};
      TimeTurn(speed_mps, random.Uniform(3.5, 5.0), when_s, path);
    } else {
      const Manner manner = kind < 0.55   ? Manner::kStopsAndStarts
                            : kind < 0.70 ? Manner::kSlowsDown
                                          : Manner::kSteady;
      // Whatever it does begins between 45 m before and 10 m behind the middle.
      path.speeds = DrawSpeeds(manner, speed_mps, when_s, random);
      path.start_offset_m = kApproach_m + random.Uniform(-45.0, 10.0) - path.ArcLengthAt(when_s);
    }
    const auto pose = [path](double time_s) { return path.PoseAt(time_s); };
    if (traffic.TryAdd(MakeVehicle(random), pose)) ++added;
  }
}

// Along the pavements, and over the roads from kerb to kerb.
void AddPedestrians(Random& random, double duration_s, Traffic& traffic) {
  int added = 0;
  for (int attempt = 0; added < kPedestrians && attempt < 1000; ++attempt) {
    Path path;
    const int corner = random.Index(4);
    const bool inward = random.Index(2) == 1;
    const double from = inward ? random.Uniform(20.0, 40.0) : random.Uniform(6.0, 12.0);
    const double side = random.Uniform(7.2, 9.2);
    path.start_W = QuarterTurns(corner) * Eigen::Vector3d(from, side, kKerbHeight_m);
    path.start_heading_rad = corner * kPi / 2.0 + (inward ? kPi : 0.0);
    const Manner manner = random.Index(3) == 0 ? Manner::kStopsAndStarts : Manner::kSteady;
    path.speeds =
        DrawSpeeds(manner, random.Uniform(1.0, 1.6), random.Uniform(0.0, duration_s), random);
    const auto pose = [path](double time_s) { return path.PoseAt(time_s); };
    if (traffic.TryAdd(MakePedestrian(random), pose)) ++added;
  }
}

}  // namespace

Scene MakeBusyCrossing(uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = "busy_crossing";
  scene.notes =
      "Traffic keeps coming: about ten vehicles within 60 m go straight, turn, brake, stop and "
      "start; pedestrians walk. The lidar stands on a corner.";
  scene.frame_count = frame_count > 0 ? frame_count : 200;
  scene.sensor = Lidar{48, 360, -22.5 * kPi / 180.0, 10.0 * kPi / 180.0, 50.0};
  const Eigen::Isometry3d eye = Upright({-9.0, -12.0, 2.1}, 0.0);
  scene.T_W_X = [eye](double) { return eye; };
  AddCrossingTown(random, scene);
  const double duration_s = (scene.frame_count + scene.future_frames) / scene.rate_hz;
  Traffic traffic(scene, duration_s, 0.5, 1.5);
  AddVehicles(random, duration_s, traffic);
  AddPedestrians(random, duration_s, traffic);
  return scene;
}

}  // namespace clearance::sim
