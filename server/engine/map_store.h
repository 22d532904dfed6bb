// The only sharing of a map: published views, and callers that wait for one.
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "server/engine/mutex.h"
#include "server/engine/timer_queue.h"
#include "server/map/map_view.h"

namespace clearance {

using ViewPtr = std::shared_ptr<const MapView>;
using ViewCallback = std::function<void(absl::StatusOr<ViewPtr>)>;

// Thread-safe; always owned by a shared_ptr. Readers never wait for the writer beyond a pointer
// copy.
class MapStore : public std::enable_shared_from_this<MapStore> {
 public:
  // Keeps the newest `kept_revisions` views findable. `timers` outlives the store.
  MapStore(ViewPtr first, TimerQueue* timers, size_t kept_revisions = 8);
  ~MapStore();

  void Publish(ViewPtr view);
  ViewPtr Latest() const;
  // OUT_OF_RANGE naming what is kept: the revision is gone, or was never reached.
  absl::StatusOr<ViewPtr> Find(uint64_t revision) const;

  // Calls `done` exactly once: at once on this thread where the newest field_revision is there,
  // otherwise from Publish, from the timer's thread at the deadline (ABORTED, naming the revision
  // reached), or from Close. Returns an id for CancelWait; 0 when already done.
  uint64_t WhenFieldRevision(uint64_t min_revision, std::chrono::steady_clock::time_point deadline,
                             ViewCallback done);
  // The callback will not run any more, unless it does so now.
  void CancelWait(uint64_t id);
  // Ends all waits, now and later, with `status`.
  void Close(absl::Status status);

 private:
  struct Wait {
    uint64_t min_revision;
    uint64_t timer;
    ViewCallback done;
  };
  void Expire(uint64_t id);

  TimerQueue* const timers_;
  const size_t kept_revisions_;
  mutable Mutex mu_;
  std::deque<ViewPtr> views_ ABSL_GUARDED_BY(mu_);  // oldest first, never empty
  std::map<uint64_t, Wait> waits_ ABSL_GUARDED_BY(mu_);
  uint64_t next_wait_ ABSL_GUARDED_BY(mu_) = 1;
  absl::Status closed_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
