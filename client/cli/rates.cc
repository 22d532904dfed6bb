#include "client/cli/rates.h"

#include <algorithm>

namespace clearance::cli {

void Rates::Take(const client::ServerStats& stats, Clock::time_point now) {
  std::map<std::string, uint64_t> counts;
  for (const client::MapStats& map : stats.maps) {
    counts["map " + map.map] = map.frames_integrated + map.frames_dropped + map.frames_rejected;
  }
  for (const client::Latency& call : stats.calls) counts["call " + call.name] = call.count;
  const double seconds =
      any_ ? std::chrono::duration<double>(now - at_).count() : std::max(stats.uptime_s, 1e-3);
  rates_.clear();
  for (const auto& [name, count] : counts) {
    const auto before = counts_.find(name);
    const uint64_t from = before == counts_.end() || before->second > count ? 0 : before->second;
    rates_[name] = static_cast<double>(count - from) / std::max(seconds, 1e-9);
  }
  counts_ = std::move(counts);
  at_ = now;
  any_ = true;
}

double Rates::Of(const std::string& name) const {
  const auto it = rates_.find(name);
  return it == rates_.end() ? 0 : it->second;
}

}  // namespace clearance::cli
