#include "planner_demo/sim/scenes/busy_traffic.h"

#include <algorithm>

namespace clearance::sim {

std::vector<Path::SpeedKnot> DrawSpeeds(Manner manner, double speed_mps, double from_s,
                                        Random& random) {
  const double brake_mps2 = random.Uniform(2.5, 4.0);
  const double start_mps2 = random.Uniform(1.5, 2.5);
  const double slow_mps =
      manner == Manner::kStopsAndStarts ? 0.0 : random.Uniform(0.35, 0.7) * speed_mps;
  const double waits_s = random.Uniform(1.5, 4.0);
  if (manner == Manner::kSteady) return {{0.0, speed_mps}};
  const double slow_s = from_s + (speed_mps - slow_mps) / brake_mps2;
  const double on_s = slow_s + waits_s;
  return {{from_s, speed_mps},
          {slow_s, slow_mps},
          {on_s, slow_mps},
          {on_s + (speed_mps - slow_mps) / start_mps2, speed_mps}};
}

void TimeTurn(double speed_mps, double turn_mps, double turn_at_s, Path& path) {
  constexpr double kBrake_mps2 = 3.0;
  constexpr double kStart_mps2 = 2.0;
  const double braking_s = std::max(0.0, speed_mps - turn_mps) / kBrake_mps2;
  const double arc_s = path.stretches[1].length_m / turn_mps;
  path.speeds = {{turn_at_s - braking_s, speed_mps},
                 {turn_at_s, turn_mps},
                 {turn_at_s + arc_s, turn_mps},
                 {turn_at_s + arc_s + (speed_mps - turn_mps) / kStart_mps2, speed_mps}};
  path.start_offset_m = 0.0;
  path.start_offset_m = path.stretches[0].length_m - path.ArcLengthAt(turn_at_s);
}

}  // namespace clearance::sim
