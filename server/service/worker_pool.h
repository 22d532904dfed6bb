// A few threads for work that is too long for the transport's own.
#pragma once

#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "server/engine/mutex.h"

namespace clearance {

// Thread-safe. Bounded: what does not fit is refused, never queued without end.
class WorkerPool {
 public:
  WorkerPool(int threads, size_t queue_capacity);
  ~WorkerPool();  // finishes what was taken

  // RESOURCE_EXHAUSTED (with RetryInfo) when full; `work` then never runs.
  absl::Status Post(std::function<void()> work);
  // Finishes what was taken, then refuses all. Idempotent.
  void Stop();

 private:
  void Run();

  const size_t capacity_;
  Mutex mu_;
  CondVar changed_;
  bool stopping_ ABSL_GUARDED_BY(mu_) = false;
  std::deque<std::function<void()>> queue_ ABSL_GUARDED_BY(mu_);
  std::vector<std::thread> threads_;
};

}  // namespace clearance
