// Reads frames ahead on a thread of its own, so that decoding overlaps with sending.
#pragma once

#include <deque>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "client/sequence/sequence.h"

namespace clearance::cli {

// One thread calls Next.
class FramePrefetcher {
 public:
  // Frames first..end-1 of `sequence`, which must outlive this; at most `ahead` wait decoded.
  FramePrefetcher(const client::Sequence& sequence, uint64_t first, uint64_t end, size_t ahead = 3);
  ~FramePrefetcher();

  // The next frame, or the error that reading it gave. OUT_OF_RANGE behind the last.
  absl::StatusOr<Frame> Next();

 private:
  void Run(const client::Sequence& sequence, uint64_t first, uint64_t end);

  const size_t ahead_;
  absl::Mutex mutex_;
  std::deque<absl::StatusOr<Frame>> ready_ ABSL_GUARDED_BY(mutex_);
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace clearance::cli
