// What became of the frames of one run.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "client/ingest_stream.h"

namespace clearance::cli {

struct IngestSummary {
  uint64_t integrated = 0, duplicate = 0, dropped = 0, rejected = 0;
  uint64_t violations = 0;
  std::vector<std::string> first_violations;  // a few, as text
  std::vector<double> queue_ms, integrate_ms;
  client::MapStamp stamp;
  uint64_t settled() const { return integrated + duplicate + dropped + rejected; }
};

// Thread-safe: acks come on the stream's thread.
class IngestCounts {
 public:
  void Add(const client::FrameAck& ack);
  IngestSummary Get() const;
  uint64_t settled() const;

 private:
  mutable absl::Mutex mutex_;
  IngestSummary summary_ ABSL_GUARDED_BY(mutex_);
};

// The value below which `share` of the sorted values lie; 0 for none.
double Percentile(std::vector<double> values, double share);

}  // namespace clearance::cli
