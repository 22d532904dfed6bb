#include "planner_demo/plan/motion_validator.h"

#include <ompl/base/ScopedState.h>
#include <ompl/base/SpaceInformation.h>

#include <algorithm>
#include <cmath>

namespace clearance::demo {

namespace ob = ompl::base;

ClearanceMotionValidator::ClearanceMotionValidator(const ob::SpaceInformationPtr& si,
                                                   const ClearanceProbe& probe)
    : ob::MotionValidator(si), space_(*si->getStateSpace()->as<SpaceTime>()), probe_(probe) {}

std::optional<double> ClearanceMotionValidator::FirstInvalid(
    const std::vector<RobotState>& states) const {
  std::vector<RobotState> samples;
  double feasible_until_s = INFINITY;
  for (size_t i = 0; i + 1 < states.size(); ++i) {
    const Steering steering = space_.Steer(states[i], states[i + 1]);
    if (!steering.feasible) {
      feasible_until_s = states[i].time_s;
      break;
    }
    const int steps =
        1 + static_cast<int>(std::max(steering.duration_s / kStep_s, steering.length_m / kStep_m));
    for (int k = i == 0 ? 0 : 1; k <= steps; ++k) {
      samples.push_back(
          space_.Along(states[i], states[i + 1], steering, steering.duration_s * k / steps));
    }
  }
  ob::ScopedState<> state(si_->getStateSpace());
  for (const RobotState& sample : samples) {
    SpaceTime::Write(sample, state.get());
    if (!si_->satisfiesBounds(state.get())) {
      feasible_until_s = std::min(feasible_until_s, sample.time_s);
      break;
    }
  }
  if (samples.empty()) return states.front().time_s;
  const auto clearances = probe_.At(samples);
  if (!clearances.ok()) return states.front().time_s;
  for (size_t i = 0; i < samples.size(); ++i) {
    if ((*clearances)[i].beyond_margin_m < 0.0F || samples[i].time_s >= feasible_until_s) {
      return samples[i].time_s;
    }
  }
  if (feasible_until_s < INFINITY) return feasible_until_s;
  return std::nullopt;
}

double ClearanceMotionValidator::ValidShare(const RobotState& from, const RobotState& to) const {
  const auto invalid_s = FirstInvalid({from, to});
  if (!invalid_s) return 1.0;
  if (to.time_s <= from.time_s) return 0.0;
  const double share = (*invalid_s - from.time_s) / (to.time_s - from.time_s);
  return std::clamp(share - kStep_s / (to.time_s - from.time_s), 0.0, 1.0);
}

bool ClearanceMotionValidator::checkMotion(const ob::State* from, const ob::State* to) const {
  const bool valid = !FirstInvalid({SpaceTime::Read(from), SpaceTime::Read(to)});
  ++(valid ? valid_ : invalid_);
  return valid;
}

bool ClearanceMotionValidator::checkMotion(const ob::State* from, const ob::State* to,
                                           std::pair<ob::State*, double>& last_valid) const {
  const double share = ValidShare(SpaceTime::Read(from), SpaceTime::Read(to));
  ++(share == 1.0 ? valid_ : invalid_);
  if (share == 1.0) return true;
  last_valid.second = share;
  if (last_valid.first != nullptr) space_.interpolate(from, to, share, last_valid.first);
  return false;
}

ClearanceStateValidity::ClearanceStateValidity(const ob::SpaceInformationPtr& si,
                                               const ClearanceProbe& probe)
    : ob::StateValidityChecker(si), probe_(probe) {}

bool ClearanceStateValidity::isValid(const ob::State* state) const {
  return si_->satisfiesBounds(state) && clearance(state) >= 0.0;
}

double ClearanceStateValidity::clearance(const ob::State* state) const {
  const auto clearances = probe_.At({SpaceTime::Read(state)});
  return clearances.ok() ? (*clearances)[0].beyond_margin_m : -INFINITY;
}

}  // namespace clearance::demo
