// OMPL's motion validator on a clearance that changes with time.
#pragma once

#include <ompl/base/MotionValidator.h>
#include <ompl/base/StateValidityChecker.h>

#include <optional>
#include <vector>

#include "planner_demo/plan/clearance_probe.h"
#include "planner_demo/plan/space_time.h"

namespace clearance::demo {

// A motion is valid where the steering between its states is feasible, every state of it is within
// the space's bounds and the robot keeps its margins all along. All samples of a motion, or of
// many, are asked in one batch. A look-up that fails makes motions invalid; see the probe's status.
class ClearanceMotionValidator final : public ompl::base::MotionValidator {
 public:
  // Samples lie at most so far apart. A surface that closes in at 16 m/s moves 0.4 m in a step;
  // margins are what covers it.
  static constexpr double kStep_s = 0.05;
  static constexpr double kStep_m = 0.1;

  // `probe` must outlive the validator.
  ClearanceMotionValidator(const ompl::base::SpaceInformationPtr& si, const ClearanceProbe& probe);

  bool checkMotion(const ompl::base::State* from, const ompl::base::State* to) const override;
  bool checkMotion(const ompl::base::State* from, const ompl::base::State* to,
                   std::pair<ompl::base::State*, double>& last_valid) const override;

  // The time of the first sample of a chain of states that is not valid; absent where all are.
  std::optional<double> FirstInvalid(const std::vector<RobotState>& states) const;

 private:
  // The share 0..1 of the motion up to which it is valid.
  double ValidShare(const RobotState& from, const RobotState& to) const;

  const SpaceTime& space_;
  const ClearanceProbe& probe_;
};

// A single state: within bounds and clear at its time.
class ClearanceStateValidity final : public ompl::base::StateValidityChecker {
 public:
  ClearanceStateValidity(const ompl::base::SpaceInformationPtr& si, const ClearanceProbe& probe);
  bool isValid(const ompl::base::State* state) const override;
  // What is left beyond the margin, for OMPL's clearance objectives.
  double clearance(const ompl::base::State* state) const override;

 private:
  const ClearanceProbe& probe_;
};

}  // namespace clearance::demo
