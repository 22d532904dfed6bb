// Latencies of many calls: percentiles, and a histogram to look at.
#pragma once

#include <string>
#include <vector>

#include "client/cli/context.h"

namespace clearance::cli {

struct LatencyBin {
  double from_ms = 0, to_ms = 0;  // from <= latency < to
  size_t count = 0;
};

// Not thread-safe: one for each caller, merged at the end.
class Latencies {
 public:
  void Add(double ms) { ms_.push_back(ms); }
  void Merge(const Latencies& other);
  size_t count() const { return ms_.size(); }

  // The value below which `share` of the calls lie; 0 without calls.
  double Percentile(double share) const;
  // Bins that double in width, from the fastest call to the slowest; empty without calls.
  std::vector<LatencyBin> Bins() const;

  // Count, mean, p50, p90, p99, p99.9, max and the bins.
  Json ToJson() const;
  // The same as a line and bars.
  std::string Text() const;

 private:
  std::vector<double> ms_;
};

}  // namespace clearance::cli
