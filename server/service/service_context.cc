#include "server/service/service_context.h"

#include "absl/strings/str_format.h"
#include "proto/wire/status_details.h"

namespace clearance {

void CallStats::Record(const char* method, absl::StatusCode code, double ms) {
  MutexLock lock(&mu_);
  latencies_[method].Add(ms);
  ++counts_[{method, code}];
}

std::vector<std::pair<std::string, LatencyHistogram>> CallStats::Latencies() const {
  MutexLock lock(&mu_);
  return {latencies_.begin(), latencies_.end()};
}

std::vector<CallStats::Entry> CallStats::Counts() const {
  MutexLock lock(&mu_);
  std::vector<Entry> entries;
  for (const auto& [key, count] : counts_) entries.push_back({key.first, key.second, count});
  return entries;
}

absl::Status DrainingError() {
  return wire::WithRetry(absl::UnavailableError("the server is draining; connect again"),
                         absl::Seconds(1));
}

absl::Status CheckRoomForStream(const ServiceContext& service) {
  const uint64_t limit = service.limits.max_streams;
  if (service.open_streams < static_cast<int64_t>(limit)) return absl::OkStatus();
  return wire::WithRetry(
      absl::ResourceExhaustedError(absl::StrFormat(
          "%d streams are open already, limit %d; close one, or raise limits.max_streams",
          service.open_streams.load(), limit)),
      absl::Seconds(1));
}

}  // namespace clearance
