#include "planner_demo/plan/clearance_probe.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace clearance::demo {
namespace {

constexpr size_t kMostPoints = 100'000;  // of one call

}  // namespace

ClearanceProbe::ClearanceProbe(Lookup lookup, RobotModel robot, Margins margins, bool frozen,
                               double max_horizon_s)
    : lookup_(std::move(lookup)),
      robot_(std::move(robot)),
      margins_(margins),
      frozen_(frozen),
      max_horizon_s_(max_horizon_s) {}

absl::StatusOr<std::vector<Clearance>> ClearanceProbe::At(
    const std::vector<RobotState>& states) const {
  const size_t spheres = robot_.spheres.size();
  std::vector<Clearance> clearances(states.size());
  const size_t most_states = kMostPoints / spheres;
  for (size_t first = 0; first < states.size(); first += most_states) {
    const size_t count = std::min(most_states, states.size() - first);
    Eigen::Matrix3Xd points_W(3, count * spheres);
    std::vector<float> horizons_s(count * spheres);
    for (size_t i = 0; i < count; ++i) {
      const RobotState& state = states[first + i];
      const double cos = std::cos(state.heading_rad), sin = std::sin(state.heading_rad);
      const double ahead_s =
          frozen_ ? 0.0 : std::clamp(state.time_s - map_time_s_, 0.0, max_horizon_s_);
      for (size_t k = 0; k < spheres; ++k) {
        const Eigen::Vector3d& c = robot_.spheres[k].center_R;
        points_W.col(i * spheres + k) =
            state.position_W +
            Eigen::Vector3d(cos * c.x() - sin * c.y(), sin * c.x() + cos * c.y(), c.z());
        horizons_s[i * spheres + k] = static_cast<float>(ahead_s);
      }
    }
    const auto answers = lookup_(points_W, horizons_s);
    if (!answers.ok()) {
      status_ = answers.status();
      return answers.status();
    }
    lookups_ += horizons_s.size();
    for (size_t i = 0; i < count; ++i) {
      Clearance& clearance = clearances[first + i];
      clearance.beyond_margin_m = INFINITY;
      for (size_t k = 0; k < spheres; ++k) {
        const size_t at = i * spheres + k;
        const bool object = answers->object_ids[at] != 0;
        const double grown_m =
            std::min(margins_.object_m + margins_.object_growth_mps * horizons_s[at],
                     margins_.object_most_m);
        const double margin_m = object ? grown_m : margins_.static_m;
        const double comfort_m = object ? margins_.comfort_object_m : margins_.comfort_static_m;
        const double gap_m = answers->distances_m[at] - robot_.spheres[k].radius_m;
        const float beyond_m = static_cast<float>(gap_m - margin_m);
        if (beyond_m < clearance.beyond_margin_m) {
          clearance.beyond_margin_m = beyond_m;
          clearance.object_id = answers->object_ids[at];
        }
        const double share = std::clamp((comfort_m - gap_m) / (comfort_m - margin_m), 0.0, 1.0);
        clearance.discomfort = std::max(clearance.discomfort, static_cast<float>(share * share));
        clearance.unknown |= client::StateOf(answers->states[at]) == client::SpaceState::kUnknown;
      }
    }
  }
  return clearances;
}

}  // namespace clearance::demo
