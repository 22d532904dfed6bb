#include "planner_demo/plan/speed_profile.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clearance::demo {
namespace {

constexpr double kLayer_s = 0.5;
constexpr int kSteps = 4;  // table rows a layer
constexpr double kSpeedStep_mps = 0.5;
constexpr double kCell_m = 0.125;  // one knot a cell and speed survives
constexpr double kEasyBrake_mps2 = 2.0;
constexpr double kStandCost = 4.0;    // a second at rest where nobody should stand
constexpr double kNoStandEnd = 40.0;  // for a plan that ends there
constexpr double kHitAtRest = 0.25;   // of what a collision at full speed costs, and more
constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct Node {
  float cost = kInfinity;
  float at_m = 0;
  int parent = -1;
};

class Search {
 public:
  explicit Search(const SpeedProblem& problem)
      : p_(problem),
        speeds_(static_cast<int>(problem.limits.max_speed_mps / kSpeedStep_mps + 1e-6) + 1),
        cells_(static_cast<int>(problem.length_m / kCell_m) + 2),
        layers_(static_cast<int>(problem.horizon_s / kLayer_s + 1e-6)) {}

  SpeedPlan Run() {
    nodes_.assign(static_cast<size_t>(layers_ + 1) * cells_ * speeds_, Node());
    Start();
    for (int layer = 1; layer < layers_; ++layer) {
      for (int i = 0; i < cells_ * speeds_; ++i) {
        const Node& node = nodes_[Index(layer, i)];
        if (node.cost < kInfinity) Expand(layer, i, node);
      }
    }
    return Best();
  }

 private:
  size_t Index(int layer, int i) const { return static_cast<size_t>(layer) * cells_ * speeds_ + i; }
  int Column(double at_m) const {
    return std::clamp(static_cast<int>(at_m / SpeedProblem::kStep_m + 0.5), 0, p_.columns - 1);
  }
  bool AtGoal(double at_m, double speed_mps) const {
    return speed_mps == 0.0 && p_.at_goal[Column(at_m)];
  }

  // Cost of moving from `from_m` with constant acceleration through one layer.
  float Step(int layer, double from_m, double from_mps, double to_mps) const {
    // Whoever has arrived is done: what may come later is no reason to leave again.
    if (AtGoal(from_m, from_mps) && to_mps == 0.0) return 0.0F;
    const double accel_mps2 = (to_mps - from_mps) / kLayer_s;
    double cost = 0.0;
    for (int k = 1; k <= kSteps; ++k) {
      const double t = k * kLayer_s / kSteps;
      const double at_m = from_m + t * (from_mps + 0.5 * accel_mps2 * t);
      const int row = std::min(layer * kSteps + k, p_.Rows() - 1);
      double rate = p_.rate[static_cast<size_t>(row) * p_.columns + Column(at_m)];
      if (rate >= SpeedProblem::kCollides) {
        const double speed_mps = from_mps + accel_mps2 * t;
        rate *= kHitAtRest + speed_mps / p_.limits.max_speed_mps;
      }
      cost += rate * SpeedProblem::kStep_s;
    }
    const double to_m = from_m + 0.5 * kLayer_s * (from_mps + to_mps);
    if (!AtGoal(to_m, to_mps)) cost += kLayer_s;
    if (to_mps == 0.0 && !p_.may_stand[Column(to_m)]) cost += kStandCost * kLayer_s;
    // Easy on the passengers.
    cost += 0.01 * accel_mps2 * accel_mps2 * kLayer_s;
    if (accel_mps2 < -kEasyBrake_mps2) cost += 0.1;
    return static_cast<float>(cost);
  }

  void Offer(int layer, double from_m, double from_mps, int to_speed, float cost_before,
             int parent) {
    const double to_mps = to_speed * kSpeedStep_mps;
    const double to_m = from_m + 0.5 * kLayer_s * (from_mps + to_mps);
    if (to_m > p_.length_m + 1e-6) return;
    if ((layer + 1) * kLayer_s <= p_.earliest_start_s + kLayer_s - 1e-6 && to_mps > 0.0) return;
    const float cost = cost_before + Step(layer, from_m, from_mps, to_mps);
    const int cell = static_cast<int>(to_m / kCell_m + 0.5);
    Node& node = nodes_[Index(layer + 1, cell * speeds_ + to_speed)];
    if (cost < node.cost) node = {cost, static_cast<float>(to_m), parent};
  }

  void Start() {
    for (int v = 0; v < speeds_; ++v) {
      const double change_mps = v * kSpeedStep_mps - p_.start_mps;
      if (change_mps > p_.limits.max_accel_mps2 * kLayer_s + 1e-6) continue;
      if (-change_mps > p_.limits.max_brake_mps2 * kLayer_s + 1e-6) continue;
      Offer(0, 0.0, p_.start_mps, v, 0.0F, -1);
    }
  }

  void Expand(int layer, int i, const Node& node) {
    const int speed = i % speeds_;
    const int up = static_cast<int>(p_.limits.max_accel_mps2 * kLayer_s / kSpeedStep_mps + 1e-6);
    const int down = static_cast<int>(p_.limits.max_brake_mps2 * kLayer_s / kSpeedStep_mps + 1e-6);
    const double at_m = node.at_m;
    const float cost = node.cost;
    for (int v = std::max(0, speed - down); v <= std::min(speeds_ - 1, speed + up); ++v) {
      Offer(layer, at_m, speed * kSpeedStep_mps, v, cost, i);
    }
  }

  // What an end at `at_m` with `speed_mps` still costs.
  float End(double at_m, double speed_mps) const {
    const double stop_m = at_m + 0.5 * speed_mps * speed_mps / kEasyBrake_mps2;
    if (stop_m > p_.length_m + 0.1) return kInfinity;
    if (AtGoal(at_m, speed_mps)) return 0.0F;
    double cost = (p_.length_m - at_m) / p_.limits.max_speed_mps + p_.beyond_end_s +
                  0.5 * (p_.limits.max_speed_mps - speed_mps) / p_.limits.max_accel_mps2;
    if (!p_.may_stand[Column(stop_m)]) cost += kNoStandEnd;
    return static_cast<float>(cost);
  }

  SpeedPlan Best() const {
    int best = -1;
    float best_cost = kInfinity;
    for (int i = 0; i < cells_ * speeds_; ++i) {
      const Node& node = nodes_[Index(layers_, i)];
      if (node.cost == kInfinity) continue;
      const float cost = node.cost + End(node.at_m, (i % speeds_) * kSpeedStep_mps);
      if (cost < best_cost) {
        best_cost = cost;
        best = i;
      }
    }
    SpeedPlan plan;
    plan.cost = best_cost;
    plan.collides = best_cost >= kHitAtRest * SpeedProblem::kCollides * SpeedProblem::kStep_s;
    if (best < 0) return plan;
    for (int layer = layers_, i = best; layer >= 1; --layer) {
      const Node& node = nodes_[Index(layer, i)];
      plan.knots.push_back({layer * kLayer_s, node.at_m, (i % speeds_) * kSpeedStep_mps});
      i = node.parent;
    }
    plan.knots.push_back({0.0, 0.0, p_.start_mps});
    std::reverse(plan.knots.begin(), plan.knots.end());
    return plan;
  }

  const SpeedProblem& p_;
  const int speeds_, cells_, layers_;
  std::vector<Node> nodes_;
};

}  // namespace

Reach ReachAt(const SpeedProblem& problem, double time_s) {
  const SpeedLimits& limits = problem.limits;
  const double v = problem.start_mps;
  const double stop_s = std::min(time_s, v / limits.max_brake_mps2);
  const double slow_m = stop_s * (v - 0.5 * limits.max_brake_mps2 * stop_s);
  const double faster_s =
      std::clamp((limits.max_speed_mps - v) / limits.max_accel_mps2, 0.0, time_s);
  const double fast_m = faster_s * (v + 0.5 * limits.max_accel_mps2 * faster_s) +
                        (time_s - faster_s) * std::max(v, limits.max_speed_mps);
  return {std::min(slow_m, problem.length_m), std::min(fast_m, problem.length_m)};
}

SpeedPlan PlanSpeeds(const SpeedProblem& problem) { return Search(problem).Run(); }

}  // namespace clearance::demo
