// What the map says about a robot's states in time, in batches.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "absl/status/statusor.h"
#include "client/types.h"
#include "planner_demo/plan/robot.h"

namespace clearance::demo {

// Distances, states and nearest objects at points, each so many seconds after the map's stamp.
using Lookup = std::function<absl::StatusOr<client::DistanceAnswers>(
    const Eigen::Matrix3Xd& points_W, const std::vector<float>& horizons_s)>;

// How far the robot keeps away. What moves gets more room the farther ahead its prediction is, as
// it may brake or turn unannounced.
struct Margins {
  double static_m = 0.05;
  double object_m = 0.20;
  double object_growth_mps = 0.08;
  double object_most_m = 0.50;
  double comfort_static_m = 0.35;  // closer than this costs, up to the margin
  double comfort_object_m = 0.95;
};

struct Clearance {
  float beyond_margin_m = 0;  // least over the spheres; below 0 the robot must not be there
  float discomfort = 0;       // 0 where everything keeps its comfortable distance, up to 1
  bool unknown = false;       // a sphere's centre was never seen
  uint32_t object_id = 0;     // what decides; 0 = static
};

class ClearanceProbe {
 public:
  // `frozen` asks for all times at the map's stamp: a map without prediction. `max_horizon_s` is
  // the map's; later states are asked there.
  ClearanceProbe(Lookup lookup, RobotModel robot, Margins margins, bool frozen,
                 double max_horizon_s);

  // The stamp that horizons count from, of the revision that answers.
  void SetMapTime(double map_time_s) { map_time_s_ = map_time_s; }

  // One look-up a sphere and state, in one batch. Errors as of the look-up.
  absl::StatusOr<std::vector<Clearance>> At(const std::vector<RobotState>& states) const;

  const RobotModel& robot() const { return robot_; }
  const Margins& margins() const { return margins_; }
  uint64_t lookups() const { return lookups_; }
  // The newest error of a look-up; planners that cannot return one leave it here.
  const absl::Status& status() const { return status_; }
  void ClearStatus() { status_ = absl::OkStatus(); }

 private:
  Lookup lookup_;
  RobotModel robot_;
  Margins margins_;
  bool frozen_;
  double max_horizon_s_;
  double map_time_s_ = 0.0;
  mutable uint64_t lookups_ = 0;
  mutable absl::Status status_;
};

}  // namespace clearance::demo
