#include "client/cli/latencies.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "absl/strings/str_format.h"

namespace clearance::cli {
namespace {

constexpr size_t kBarWidth = 50;
constexpr double kFinest_ms = 1.0 / 1024;  // all below share a bin

// Bin b holds [2^b, 2^(b + 1)) ms.
int BinOf(double ms) { return static_cast<int>(std::floor(std::log2(std::max(ms, kFinest_ms)))); }

}  // namespace

void Latencies::Merge(const Latencies& other) {
  ms_.insert(ms_.end(), other.ms_.begin(), other.ms_.end());
}

double Latencies::Percentile(double share) const {
  if (ms_.empty()) return 0;
  std::vector<double> sorted = ms_;
  const auto rank = static_cast<size_t>(std::ceil(share * static_cast<double>(sorted.size())));
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(std::max<size_t>(rank, 1) - 1);
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at;
}

std::vector<LatencyBin> Latencies::Bins() const {
  std::vector<LatencyBin> bins;
  if (ms_.empty()) return bins;
  const auto [low, high] = std::minmax_element(ms_.begin(), ms_.end());
  const int first = BinOf(*low);
  for (int b = first; b <= BinOf(*high); ++b) bins.push_back({std::exp2(b), std::exp2(b + 1), 0});
  for (const double ms : ms_) ++bins[static_cast<size_t>(BinOf(ms) - first)].count;
  return bins;
}

Json Latencies::ToJson() const {
  const double sum = std::accumulate(ms_.begin(), ms_.end(), 0.0);
  Json json = {{"count", count()},
               {"mean_ms", ms_.empty() ? 0 : sum / static_cast<double>(count())},
               {"p50_ms", Percentile(0.5)},
               {"p90_ms", Percentile(0.9)},
               {"p99_ms", Percentile(0.99)},
               {"p999_ms", Percentile(0.999)},
               {"max_ms", Percentile(1)},
               {"histogram", Json::array()}};
  for (const LatencyBin& bin : Bins()) {
    json["histogram"].push_back(
        {{"from_ms", bin.from_ms}, {"to_ms", bin.to_ms}, {"count", bin.count}});
  }
  return json;
}

std::string Latencies::Text() const {
  std::string text =
      absl::StrFormat("p50 %.3f  p90 %.3f  p99 %.3f  p99.9 %.3f  max %.3f ms\n", Percentile(0.5),
                      Percentile(0.9), Percentile(0.99), Percentile(0.999), Percentile(1));
  const std::vector<LatencyBin> bins = Bins();
  size_t most = 1;
  for (const LatencyBin& bin : bins) most = std::max(most, bin.count);
  for (const LatencyBin& bin : bins) {
    const size_t width = (bin.count * kBarWidth + most - 1) / most;
    absl::StrAppendFormat(&text, "%9.3f to %9.3f ms %8d %s\n", bin.from_ms, bin.to_ms, bin.count,
                          std::string(width, '#'));
  }
  return text;
}

}  // namespace clearance::cli
