// Episodes in figures: the table, and one JSON object.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "planner_demo/episode/episode.h"

namespace clearance::demo {

struct RowSummary {
  Row row = Row::kClearance;
  int episodes = 0;
  int collisions = 0;  // caused by the robot
  int run_over = 0;    // not caused by it
  double success_rate = 0.0;
  double min_clearance_m = 0.0;                         // least of all drives; 0 with a collision
  double median_clearance_m = 0.0;                      // of the drives' least
  double time_to_goal_s = 0.0;                          // mean of those that arrived in time
  double planning_ms_p50 = 0.0, planning_ms_p95 = 0.0;  // wall clock, a cycle
  double planning_cpu_ms_p95 = 0.0;                     // of the planning thread
  double integrate_ms_p50 = 0.0;
  double queries_per_s = 0.0;  // look-ups a second of planning
  int late_cycles = 0;
};

// q in 0..1; 0 for no values.
double Quantile(std::vector<double> values, double q);
RowSummary Summarise(const std::vector<EpisodeResult>& results);
std::string Table(const std::vector<RowSummary>& rows);
// Keyed by the rows' names.
nlohmann::json ToJson(const std::vector<RowSummary>& rows);

}  // namespace clearance::demo
