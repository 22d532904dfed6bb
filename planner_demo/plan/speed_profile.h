// The best speeds along one curve through a clearance that changes with time.
#pragma once

#include <cstdint>
#include <vector>

namespace clearance::demo {

struct SpeedLimits {
  double max_speed_mps = 4.0;
  double max_accel_mps2 = 2.0;
  double max_brake_mps2 = 4.0;
};

// What it costs to be somewhere on the curve at some time: cells of step_m by step_s.
struct SpeedProblem {
  static constexpr double kStep_m = 0.25;
  static constexpr double kStep_s = 0.125;
  static constexpr float kCollides = 1e4F;  // a second; more the deeper and faster

  double length_m = 0.0;
  double start_mps = 0.0;
  double earliest_start_s = 0.0;  // stands until then
  double horizon_s = 6.0;
  SpeedLimits limits;
  double beyond_end_s = 0.0;       // what is left to do behind the curve's end, in seconds
  int columns = 0;                 // along the curve
  std::vector<float> rate;         // row by row, one row a time step: cost a second
  std::vector<uint8_t> may_stand;  // by column
  std::vector<uint8_t> at_goal;    // by column: a robot at rest there has arrived

  int Rows() const { return static_cast<int>(horizon_s / kStep_s + 0.5) + 1; }
};

struct SpeedKnot {
  double time_s, at_m, speed_mps;
};

struct SpeedPlan {
  std::vector<SpeedKnot> knots;  // acceleration is constant between them
  double cost = 0.0;             // seconds, with what collisions and stops on the way cost
  bool collides = false;
};

// The stretch of the curve within reach at a time after the start, ends included.
struct Reach {
  double from_m, to_m;
};
Reach ReachAt(const SpeedProblem& problem, double time_s);

// Dynamic programming over time (layers of half a second), place and speed. Every plan ends at
// rest, or slow enough to stop behind its end, within length_m and, if it can, where standing is
// allowed. Time counts until the goal is reached; a collision that cannot be avoided is put off and
// kept shallow.
SpeedPlan PlanSpeeds(const SpeedProblem& problem);

}  // namespace clearance::demo
