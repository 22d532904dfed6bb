#include <cmath>
#include <numbers>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scenes/crossing_town.h"
#include "planner_demo/sim/scenes/scenes.h"
#include "planner_demo/sim/traffic.h"

namespace clearance::sim {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kVehicles = 10;
constexpr int kTurning = 3;  // of these
constexpr int kPedestrians = 2;

// The path of a vehicle that comes from the west (heading +x) and goes straight on, right or left.
Path Route(int turn, int approach) {
  Path path;
  if (turn != 0) {
    // Turn radii that lead from lane to lane past the kerb's corner.
    const double radius = turn > 0 ? 8.0 : 5.0;
    const double begins = turn > 0 ? kLane_m - radius : -kLane_m - radius;
    path.stretches = {{kApproach_m + begins, 0.0}, {radius * kPi / 2.0, turn / radius}};
  }
  const Eigen::Isometry3d T = QuarterTurns(approach);
  path.start_W = T * Eigen::Vector3d(-kApproach_m, -kLane_m, 0.0);
  path.start_heading_rad = approach * kPi / 2.0;
  return path;
}

void AddVehicles(Random& random, double duration_s, Traffic& traffic) {
  int added = 0;
  for (int attempt = 0; added < kVehicles && attempt < 4000; ++attempt) {
    // A few turn, in the middle of the recording; the others go straight on.
    const int turn = added >= kTurning ? 0 : random.Index(2) == 0 ? -1 : 1;
    Path path = Route(turn, random.Index(4));
    const double speed = turn == 0 ? random.Uniform(7.0, 12.0) : random.Uniform(5.0, 6.0);
    if (turn != 0) {
      path.start_offset_m = random.Uniform(15.0, 50.0);
    } else {
      path.start_offset_m = random.Uniform(0.0, 1.0) < 0.7 ? random.Uniform(0.0, kApproach_m)
                                                           : random.Uniform(-60.0, 0.0);
    }
    path.speeds = {{0.0, speed}};
    if (turn == 0 && random.Uniform(0.0, 1.0) < 0.3) {  // slows down on the way
      const double from_s = random.Uniform(0.5, 0.5 * duration_s);
      path.speeds = {{from_s, speed}, {from_s + 2.0, random.Uniform(5.0, 7.0)}};
    }
    const auto pose = [path](double time_s) { return path.PoseAt(time_s); };
    if (traffic.TryAdd(MakeVehicle(random), pose)) ++added;
  }
}

void AddPedestrians(Random& random, Traffic& traffic) {
  int added = 0;
  for (int attempt = 0; added < kPedestrians && attempt < 1000; ++attempt) {
    Path path;
    const int corner = random.Index(4);
    const bool inward = random.Index(2) == 1;
    const double from = inward ? random.Uniform(28.0, 40.0) : random.Uniform(6.0, 12.0);
    path.start_W = QuarterTurns(corner) * Eigen::Vector3d(from, 8.8, kKerbHeight_m);
    path.start_heading_rad = corner * kPi / 2.0 + (inward ? kPi : 0.0);
    path.speeds = {{0.0, random.Uniform(1.0, 1.6)}};
    const auto pose = [path](double time_s) { return path.PoseAt(time_s); };
    if (traffic.TryAdd(MakePedestrian(random), pose)) ++added;
  }
}

}  // namespace

Scene MakeCrossing(uint64_t seed, int frame_count) {
  Random random(seed);
  Scene scene;
  scene.name = "crossing";
  scene.notes =
      "Vehicles on straight and turning paths, pedestrians on the pavement; the lidar "
      "stands at the kerb.";
  scene.frame_count = frame_count > 0 ? frame_count : 60;
  scene.future_frames = 100;
  scene.sensor = Lidar{64, 512, -22.5 * kPi / 180.0, 22.5 * kPi / 180.0, 40.0};
  const Eigen::Isometry3d eye =
      Upright({random.Uniform(5.8, 6.6), random.Uniform(-6.8, -6.2), 1.33}, 0.8 * kPi) *
      Eigen::AngleAxisd(random.Uniform(-0.01, 0.01), Eigen::Vector3d::UnitX());
  scene.T_W_X = [eye](double) { return eye; };
  AddCrossingTown(random, scene);
  const double duration_s = (scene.frame_count + scene.future_frames) / scene.rate_hz;
  Traffic traffic(scene, duration_s, 0.5, 1.0);
  AddVehicles(random, duration_s, traffic);
  AddPedestrians(random, traffic);
  return scene;
}

}  // namespace clearance::sim
