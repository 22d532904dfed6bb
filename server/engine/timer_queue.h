// Deadlines of callers that wait without holding a thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <thread>
#include <utility>

#include "server/engine/mutex.h"

namespace clearance {

// Runs callbacks at their time on one thread of its own; they must be short. Thread-safe.
class TimerQueue {
 public:
  using Clock = std::chrono::steady_clock;

  TimerQueue();
  ~TimerQueue();  // callbacks that are not due yet never run

  uint64_t Schedule(Clock::time_point when, std::function<void()> callback);
  // False when the callback has run, runs now, or was never scheduled.
  bool Cancel(uint64_t id);

 private:
  void Run();

  Mutex mu_;
  CondVar changed_;
  bool stopping_ ABSL_GUARDED_BY(mu_) = false;
  uint64_t next_id_ ABSL_GUARDED_BY(mu_) = 1;
  std::map<std::pair<Clock::time_point, uint64_t>, std::function<void()>> due_ ABSL_GUARDED_BY(mu_);
  std::map<uint64_t, Clock::time_point> when_ ABSL_GUARDED_BY(mu_);
  std::thread thread_;
};

}  // namespace clearance
