#include "planner_demo/episode/report.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace clearance::demo {
namespace {

const char* TitleOf(Row row) {
  switch (row) {
    case Row::kClearance:
      return "map and prediction";
    case Row::kFrozenSnapshot:
      return "frozen snapshot";
    case Row::kStaticFusion:
      return "static fusion";
    case Row::kStraightAhead:
      return "straight ahead, blind";
  }
  return "";
}

}  // namespace

double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0.0;
  const size_t at = static_cast<size_t>(q * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

RowSummary Summarise(const std::vector<EpisodeResult>& results) {
  RowSummary summary;
  std::vector<double> wall_ms, cpu_ms, integrate_ms, clearances_m;
  double planning_s = 0.0, lookups = 0.0, arrived_s = 0.0;
  int arrived = 0;
  for (const EpisodeResult& result : results) {
    summary.row = result.row;
    ++summary.episodes;
    if (result.verdict.collision) {
      ++(result.verdict.collision->caused ? summary.collisions : summary.run_over);
    }
    clearances_m.push_back(std::max(0.0, result.verdict.min_clearance_m));
    if (result.in_time) {
      ++arrived;
      arrived_s += result.time_to_goal_s;
    }
    for (const Cycle& cycle : result.cycles) {
      wall_ms.push_back(cycle.wall_ms);
      cpu_ms.push_back(cycle.cpu_ms);
      planning_s += 1e-3 * cycle.wall_ms;
      lookups += static_cast<double>(cycle.lookups);
      summary.late_cycles += cycle.late;
    }
    integrate_ms.insert(integrate_ms.end(), result.integrate_ms.begin(), result.integrate_ms.end());
  }
  if (summary.episodes > 0) {
    summary.success_rate = static_cast<double>(arrived) / summary.episodes;
    summary.min_clearance_m = *std::min_element(clearances_m.begin(), clearances_m.end());
  }
  summary.median_clearance_m = Quantile(clearances_m, 0.5);
  summary.time_to_goal_s = arrived > 0 ? arrived_s / arrived : 0.0;
  summary.planning_ms_p50 = Quantile(wall_ms, 0.5);
  summary.planning_ms_p95 = Quantile(wall_ms, 0.95);
  summary.planning_cpu_ms_p95 = Quantile(cpu_ms, 0.95);
  summary.integrate_ms_p50 = Quantile(integrate_ms, 0.5);
  summary.queries_per_s = planning_s > 0.0 ? lookups / planning_s : 0.0;
  return summary;
}

std::string Table(const std::vector<RowSummary>& rows) {
  std::string text = absl::StrFormat(
      "%-22s %8s %10s %8s %9s %9s %7s %15s %9s\n%-22s %8s %10s %8s %9s %9s %7s %15s %9s\n", "",
      "arrived", "collisions", "run", "closest", "(median)", "time", "planning ms", "look-ups", "",
      "in time", "caused", "over", "ever m", "m", "s", "p50 / p95 (cpu)", "million/s");
  for (const RowSummary& row : rows) {
    absl::StrAppend(
        &text,
        absl::StrFormat(
            "%-22s %7.0f%% %10s %8d %9.2f %9.2f %7s %15s %9s\n", TitleOf(row.row),
            100.0 * row.success_rate, absl::StrFormat("%d of %d", row.collisions, row.episodes),
            row.run_over, row.min_clearance_m, row.median_clearance_m,
            row.time_to_goal_s > 0 ? absl::StrFormat("%.1f", row.time_to_goal_s) : "-",
            row.planning_ms_p50 > 0 ? absl::StrFormat("%.0f / %.0f (%.0f)", row.planning_ms_p50,
                                                      row.planning_ms_p95, row.planning_cpu_ms_p95)
                                    : "-",
            row.queries_per_s > 0 ? absl::StrFormat("%.2f", 1e-6 * row.queries_per_s) : "-"));
  }
  return text;
}

nlohmann::json ToJson(const std::vector<RowSummary>& rows) {
  nlohmann::json json;
  for (const RowSummary& row : rows) {
    json[NameOf(row.row)] = {{"episodes", row.episodes},
                             {"collisions", row.collisions},
                             {"run_over_while_standing", row.run_over},
                             {"success_rate", row.success_rate},
                             {"min_clearance_m", row.min_clearance_m},
                             {"median_clearance_m", row.median_clearance_m},
                             {"time_to_goal_s", row.time_to_goal_s},
                             {"planning_ms_p50", row.planning_ms_p50},
                             {"planning_ms_p95", row.planning_ms_p95},
                             {"planning_cpu_ms_p95", row.planning_cpu_ms_p95},
                             {"integrate_ms_p50", row.integrate_ms_p50},
                             {"queries_per_s", row.queries_per_s},
                             {"late_cycles", row.late_cycles}};
  }
  return json;
}

}  // namespace clearance::demo
