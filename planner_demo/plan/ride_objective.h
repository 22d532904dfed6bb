// What a good ride costs: time, and time spent close to things.
#pragma once

#include <ompl/base/OptimizationObjective.h>

#include "planner_demo/plan/clearance_probe.h"
#include "planner_demo/plan/space_time.h"

namespace clearance::demo {

// Seconds: a motion costs its duration, kDiscomfort times the discomfort of its samples, and what
// it adds to the time that the rest of the way takes at full speed. That last part depends on the
// ends alone, so the sum over a path tells which of two plans of limited length gets there sooner.
class RideObjective final : public ompl::base::OptimizationObjective {
 public:
  static constexpr double kDiscomfort = 3.0;
  static constexpr double kUnknown = 0.3;  // a second where nobody has looked yet

  RideObjective(const ompl::base::SpaceInformationPtr& si, const ClearanceProbe& probe,
                const Eigen::Vector3d& goal_W);

  ompl::base::Cost stateCost(const ompl::base::State* state) const override;
  ompl::base::Cost motionCost(const ompl::base::State* from,
                              const ompl::base::State* to) const override;
  bool isSymmetric() const override { return false; }

  // Seconds to the goal at full speed.
  double Left(const RobotState& state) const;
  static double Rate(const Clearance& clearance) {
    return kDiscomfort * clearance.discomfort + (clearance.unknown ? kUnknown : 0.0);
  }

 private:
  const SpaceTime& space_;
  const ClearanceProbe& probe_;
  const Eigen::Vector3d goal_W_;
};

}  // namespace clearance::demo
