// Latencies as counts in logarithmic buckets: bounded memory, quantiles to a few per cent.
#pragma once

#include <array>
#include <cstdint>

namespace clearance {

struct LatencySummary {
  uint64_t count = 0;
  double mean_ms = 0, p50_ms = 0, p95_ms = 0, p99_ms = 0, max_ms = 0;
};

// Not thread-safe; the owner locks.
class LatencyHistogram {
 public:
  // 8 buckets an octave from 1 us to about 4,000 s.
  static constexpr int kBuckets = 256;

  void Add(double ms);
  LatencySummary Summary() const;
  uint64_t count() const { return count_; }
  double sum_ms() const { return sum_ms_; }
  // Samples at or below `ms`, up to the width of a bucket.
  uint64_t CountUpTo(double ms) const;

 private:
  double Quantile(double q) const;

  std::array<uint64_t, kBuckets> buckets_{};
  uint64_t count_ = 0;
  double sum_ms_ = 0, max_ms_ = 0;
};

}  // namespace clearance
