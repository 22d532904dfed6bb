#include "server/engine/map_store.h"

#include <utility>

#include "absl/strings/str_format.h"

namespace clearance {

MapStore::MapStore(ViewPtr first, TimerQueue* timers, size_t kept_revisions)
    : timers_(timers), kept_revisions_(kept_revisions) {
  views_.push_back(std::move(first));
}

MapStore::~MapStore() { Close(absl::UnavailableError("the map is closed")); }

void MapStore::Publish(ViewPtr view) {
  std::vector<Wait> reached;
  ViewPtr evicted;  // freed without the lock: a view may hold many megabytes
  {
    MutexLock lock(&mu_);
    views_.push_back(view);
    if (views_.size() > kept_revisions_) {
      evicted = std::move(views_.front());
      views_.pop_front();
    }
    for (auto it = waits_.begin(); it != waits_.end();) {
      if (it->second.min_revision <= view->field_revision) {
        reached.push_back(std::move(it->second));
        it = waits_.erase(it);
      } else {
        ++it;
      }
    }
  }
  for (Wait& wait : reached) {
    timers_->Cancel(wait.timer);
    wait.done(view);
  }
}

ViewPtr MapStore::Latest() const {
  MutexLock lock(&mu_);
  return views_.back();
}

absl::StatusOr<ViewPtr> MapStore::Find(uint64_t revision) const {
  MutexLock lock(&mu_);
  for (const ViewPtr& view : views_) {
    if (view->revision == revision) return view;
  }
  return absl::OutOfRangeError(absl::StrFormat("revision %d is not kept: %d to %d are", revision,
                                               views_.front()->revision, views_.back()->revision));
}

uint64_t MapStore::WhenFieldRevision(uint64_t min_revision,
                                     std::chrono::steady_clock::time_point deadline,
                                     ViewCallback done) {
  ViewPtr view;
  absl::Status closed;
  {
    MutexLock lock(&mu_);
    if (views_.back()->field_revision >= min_revision) {
      view = views_.back();
    } else if (closed_.ok()) {
      const uint64_t id = next_wait_++;
      const uint64_t timer = timers_->Schedule(deadline, [weak = weak_from_this(), id] {
        if (const auto store = weak.lock()) store->Expire(id);
      });
      waits_.emplace(id, Wait{min_revision, timer, std::move(done)});
      return id;
    } else {
      closed = closed_;
    }
  }
  if (view) {
    done(std::move(view));
  } else {
    done(closed);
  }
  return 0;
}

void MapStore::Expire(uint64_t id) {
  ViewCallback done;
  absl::Status status;
  {
    MutexLock lock(&mu_);
    const auto it = waits_.find(id);
    if (it == waits_.end()) return;
    status = absl::AbortedError(absl::StrFormat(
        "consistency.min_revision: field revision %d was not reached in wait_s; the map "
        "is at %d. Ask again, wait longer, or lower min_revision",
        it->second.min_revision, views_.back()->field_revision));
    done = std::move(it->second.done);
    waits_.erase(it);
  }
  done(status);
}

void MapStore::CancelWait(uint64_t id) {
  ViewCallback dropped;
  MutexLock lock(&mu_);
  const auto it = waits_.find(id);
  if (it == waits_.end()) return;
  timers_->Cancel(it->second.timer);
  dropped = std::move(it->second.done);
  waits_.erase(it);
}

void MapStore::Close(absl::Status status) {
  std::map<uint64_t, Wait> waits;
  {
    MutexLock lock(&mu_);
    if (closed_.ok()) closed_ = status;
    waits.swap(waits_);
  }
  for (auto& [id, wait] : waits) {
    timers_->Cancel(wait.timer);
    wait.done(status);
  }
}

}  // namespace clearance
