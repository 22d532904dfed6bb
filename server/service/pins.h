// Revisions that callers keep answerable for a while.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/engine/map_store.h"
#include "server/engine/mutex.h"
#include "server/engine/timer_queue.h"

namespace clearance {

struct PinLimits {
  size_t max_pins = 64;  // of one map: each may hold blocks that no other revision has
  double default_ttl_s = 10;
  double max_ttl_s = 120;
};

// Thread-safe; always owned by a shared_ptr. A pin belongs to one map in one epoch: it ends when
// its time is up, when it is released, or, to callers, when the map is made anew.
class PinTable : public std::enable_shared_from_this<PinTable> {
 public:
  // `timers` outlives the table.
  PinTable(PinLimits limits, TimerQueue* timers) : limits_(limits), timers_(timers) {}

  struct Pin {
    uint64_t id = 0;
    double ttl_s = 0;
  };
  // `ttl_s` 0 = the default; more than the largest is cut to it. RESOURCE_EXHAUSTED (with RetryInfo
  // of the pin that ends first) where the map has too many.
  absl::StatusOr<Pin> Add(const std::string& map, ViewPtr view, double ttl_s);
  // NOT_FOUND naming the pins that exist.
  absl::StatusOr<ViewPtr> Find(const std::string& map, uint64_t epoch, uint64_t id) const;
  absl::StatusOr<ViewPtr> Release(const std::string& map, uint64_t epoch, uint64_t id);
  size_t Count(const std::string& map) const;

 private:
  using Clock = std::chrono::steady_clock;
  struct Held {
    std::string map;
    ViewPtr view;
    Clock::time_point ends_at;
    uint64_t timer = 0;
  };
  void Expire(uint64_t id);
  absl::Status NotFound(const std::string& map, uint64_t epoch, uint64_t id) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);

  const PinLimits limits_;
  TimerQueue* const timers_;
  mutable Mutex mu_;
  uint64_t last_id_ ABSL_GUARDED_BY(mu_) = 0;
  std::map<uint64_t, Held> pins_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
