#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "planner_demo/sim/bodies.h"
#include "planner_demo/sim/scene.h"

namespace clearance::sim {

// Adds movers to a scene that keep clear of everything in it, from time 0 to `duration_s`: drawn
// motions are tried and refused, so that no two objects of a scene ever overlap.
class Traffic {
 public:
  // Movers stay `margin_m` away from each other and from what stands between 0.3 and 2 m above
  // ground, and `sensor_margin_m` from the sensor.
  Traffic(Scene& scene, double duration_s, double margin_m, double sensor_margin_m);

  // Adds the body moving along `T_W_L`, unless it would come too close to anything.
  bool TryAdd(Body body, const PoseFunction& T_W_L);

 private:
  using Discs =
      std::vector<Eigen::Vector2d>;  // covering the footprint, all times one after another
  struct Track {
    double radius_m;
    int discs_per_time;
    Discs discs_W;
  };

  bool ClearOfStatic(const Track& track) const;
  bool ClearOfTrack(const Track& a, const Track& b) const;

  Scene& scene_;
  std::vector<double> times_s_;
  double margin_m_;
  double sensor_margin_m_;
  std::vector<Track> tracks_;
};

}  // namespace clearance::sim
