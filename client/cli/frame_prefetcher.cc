#include "client/cli/frame_prefetcher.h"

#include <utility>

namespace clearance::cli {

FramePrefetcher::FramePrefetcher(const client::Sequence& sequence, uint64_t first, uint64_t end,
                                 size_t ahead)
    : ahead_(ahead), thread_([this, &sequence, first, end] { Run(sequence, first, end); }) {}

FramePrefetcher::~FramePrefetcher() {
  {
    absl::MutexLock lock(&mutex_);
    stop_ = true;
  }
  thread_.join();
}

void FramePrefetcher::Run(const client::Sequence& sequence, uint64_t first, uint64_t end) {
  bool ok = true;
  for (uint64_t i = first; i < end && ok; ++i) {
    absl::StatusOr<Frame> frame = sequence.Read(i);
    ok = frame.ok();
    const auto room = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return stop_ || ready_.size() < ahead_;
    };
    absl::MutexLock lock(&mutex_, absl::Condition(&room));
    if (stop_) return;
    ready_.push_back(std::move(frame));
  }
  absl::MutexLock lock(&mutex_);
  finished_ = true;
}

absl::StatusOr<Frame> FramePrefetcher::Next() {
  const auto has_something = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return finished_ || !ready_.empty();
  };
  absl::MutexLock lock(&mutex_, absl::Condition(&has_something));
  if (ready_.empty()) return absl::OutOfRangeError("no more frames");
  absl::StatusOr<Frame> frame = std::move(ready_.front());
  ready_.pop_front();
  return frame;
}

}  // namespace clearance::cli
