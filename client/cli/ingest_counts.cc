#include "client/cli/ingest_counts.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace clearance::cli {
namespace {

constexpr size_t kShownViolations = 5;

}  // namespace

void IngestCounts::Add(const client::FrameAck& ack) {
  absl::MutexLock lock(&mutex_);
  switch (ack.status) {
    case client::AckStatus::kIntegrated:
      ++summary_.integrated;
      summary_.queue_ms.push_back(ack.queue_ms);
      summary_.integrate_ms.push_back(ack.integrate_ms);
      break;
    case client::AckStatus::kDuplicate:
      ++summary_.duplicate;
      break;
    case client::AckStatus::kDropped:
      ++summary_.dropped;
      break;
    case client::AckStatus::kRejected:
      ++summary_.rejected;
      break;
    case client::AckStatus::kAccepted:
    case client::AckStatus::kUnspecified:
      return;
  }
  summary_.stamp = ack.stamp;
  summary_.violations += ack.violations.size();
  for (const Violation& v : ack.violations) {
    if (summary_.first_violations.size() >= kShownViolations) break;
    summary_.first_violations.push_back(absl::StrFormat(
        "frame %d: %s%s%s", ack.frame_id, v.field,
        v.index >= 0 ? absl::StrFormat("[%d]: ", v.index) : (v.field.empty() ? "" : ": "),
        v.description));
  }
}

IngestSummary IngestCounts::Get() const {
  absl::MutexLock lock(&mutex_);
  return summary_;
}

uint64_t IngestCounts::settled() const {
  absl::MutexLock lock(&mutex_);
  return summary_.settled();
}

double Percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const size_t k = std::min(values.size() - 1, static_cast<size_t>(share * values.size()));
  std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(k), values.end());
  return values[k];
}

}  // namespace clearance::cli
