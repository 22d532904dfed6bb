// Watches a drive against the truth.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "planner_demo/episode/truth.h"
#include "planner_demo/plan/mission.h"

namespace clearance::demo {

struct Collision {
  double time_s = 0.0;
  uint16_t object_id = 0;  // 0: static
  // The robot moved, or had stopped where it should not or less than a second before. Otherwise it
  // stood where it may and was run over.
  bool caused = false;
  std::string cause;
};

struct Verdict {
  double min_clearance_m = 1e9;  // of the robot's surface, at any time of the drive
  double min_clearance_at_s = 0.0;
  std::optional<Collision> collision;
  std::optional<double> reached_s;  // at rest within the goal's radius
};

class Judge {
 public:
  // All must outlive the judge.
  Judge(const Truth& truth, const RobotModel& robot, const Mission& mission);

  // Judges the time since the last call (from `from_s` at first). Steps are so short that nothing
  // closing in at 20 m/s is missed by more than 2 cm. Ends with the first collision.
  void Advance(const std::function<RobotState(double)>& drive, double from_s, double to_s);

  const Verdict& verdict() const { return verdict_; }
  // The robot's clearance at a state.
  double Clearance(const RobotState& state, uint16_t* object_id) const;

 private:
  const Truth& truth_;
  const RobotModel& robot_;
  const Mission& mission_;
  Verdict verdict_;
  std::optional<double> stands_since_s_;
};

}  // namespace clearance::demo
