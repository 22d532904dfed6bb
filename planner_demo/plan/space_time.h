// The planner's state space: where, heading, how fast, when.
#pragma once

#include <ompl/base/StateSpace.h>

#include <memory>
#include <vector>

#include "planner_demo/plan/robot.h"

namespace clearance::demo {

// How one state leads to another: along the shortest curve that the robot can turn, with one speed
// halfway in time that makes the length fit the duration (speed is linear on both halves).
struct Steering {
  bool feasible = false;  // forward in time, within the limits of speed, acceleration and climb
  double length_m = 0.0;
  double duration_s = 0.0;
  double middle_mps = 0.0;
};

// OMPL's view of RobotState: the plane (joined by Dubins curves), height, speed and time.
// Distances are directed and no metric: the duration where the steering is feasible, more than
// kUnreachable elsewhere, so planners look for neighbours in time.
class SpaceTime final : public ompl::base::CompoundStateSpace {
 public:
  static constexpr double kUnreachable = 1e3;

  // Bounds: metres in W (z counts for robots that climb), seconds.
  struct Bounds {
    Eigen::Vector3d min_W, max_W;
    double from_s, to_s;
  };
  SpaceTime(const RobotModel& robot, const Bounds& bounds);

  const RobotModel& robot() const { return robot_; }
  static RobotState Read(const ompl::base::State* state);
  static void Write(const RobotState& from, ompl::base::State* state);

  Steering Steer(const RobotState& from, const RobotState& to) const;
  // The state `at_s` seconds (0 .. steering.duration_s) behind `from`.
  RobotState Along(const RobotState& from, const RobotState& to, const Steering& steering,
                   double at_s) const;
  // The shortest curve's length over ground.
  double GroundLength(const RobotState& from, const RobotState& to) const;
  // The pose a share 0..1 of the curve's length behind `from`; speed and time are left 0.
  RobotState OnCurve(const RobotState& from, const RobotState& to, double share) const;

  double distance(const ompl::base::State* from, const ompl::base::State* to) const override;
  void interpolate(const ompl::base::State* from, const ompl::base::State* to, double share,
                   ompl::base::State* state) const override;
  bool isMetricSpace() const override { return false; }
  bool hasSymmetricDistance() const override { return false; }
  bool hasSymmetricInterpolate() const override { return false; }

 private:
  RobotModel robot_;
};

// A plan: states in the order of time, joined by the space's steering.
class Trajectory {
 public:
  Trajectory() = default;
  Trajectory(std::shared_ptr<const SpaceTime> space, std::vector<RobotState> states);

  bool empty() const { return states_.empty(); }
  const std::vector<RobotState>& states() const { return states_; }
  double begins_s() const { return states_.front().time_s; }
  double ends_s() const { return states_.back().time_s; }
  // At rest where the first or last state is outside of its time.
  RobotState At(double time_s) const;
  // Every `step_s` from `from_s` to `to_s`, both included.
  std::vector<RobotState> Sample(double from_s, double to_s, double step_s) const;

 private:
  std::shared_ptr<const SpaceTime> space_;
  std::vector<RobotState> states_;
  std::vector<Steering> steering_;  // from state i to i + 1
};

}  // namespace clearance::demo
