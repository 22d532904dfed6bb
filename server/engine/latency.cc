#include "server/engine/latency.h"

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

constexpr double kFirstMs = 1e-3;
constexpr double kPerOctave = 8.0;

int BucketOf(double ms) {
  if (!(ms > kFirstMs)) return 0;
  const int bucket = static_cast<int>(std::ceil(std::log2(ms / kFirstMs) * kPerOctave));
  return std::min(bucket, LatencyHistogram::kBuckets - 1);
}

double UpperMs(int bucket) { return kFirstMs * std::exp2(bucket / kPerOctave); }

}  // namespace

void LatencyHistogram::Add(double ms) {
  ++buckets_[BucketOf(ms)];
  ++count_;
  sum_ms_ += ms;
  max_ms_ = std::max(max_ms_, ms);
}

double LatencyHistogram::Quantile(double q) const {
  const uint64_t rank = std::max<uint64_t>(1, static_cast<uint64_t>(std::ceil(q * count_)));
  uint64_t seen = 0;
  for (int b = 0; b < kBuckets; ++b) {
    seen += buckets_[b];
    if (seen >= rank) return std::min(UpperMs(b), max_ms_);
  }
  return max_ms_;
}

LatencySummary LatencyHistogram::Summary() const {
  if (count_ == 0) return {};
  return {count_, sum_ms_ / count_, Quantile(0.5), Quantile(0.95), Quantile(0.99), max_ms_};
}

uint64_t LatencyHistogram::CountUpTo(double ms) const {
  const int last = BucketOf(ms);
  uint64_t seen = 0;
  for (int b = 0; b <= last; ++b) seen += buckets_[b];
  return seen;
}

}  // namespace clearance
