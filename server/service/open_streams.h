// Streams that are open, so that a drain can end them.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <utility>

#include "server/engine/mutex.h"

namespace clearance {

// Thread-safe.
class OpenStreams {
 public:
  // `end` is called at most once, by EndAll; it must be short and may be called until Remove
  // returns or during it. After EndAll it is called at once.
  uint64_t Add(std::function<void()> end) {
    {
      MutexLock lock(&mu_);
      if (!ended_) {
        ends_.emplace(++last_id_, std::move(end));
        return last_id_;
      }
    }
    end();
    return 0;
  }

  void Remove(uint64_t id) {
    MutexLock lock(&mu_);
    ends_.erase(id);
  }

  void EndAll() {
    std::map<uint64_t, std::function<void()>> ends;
    {
      MutexLock lock(&mu_);
      ended_ = true;
      ends.swap(ends_);
    }
    for (const auto& [id, end] : ends) end();
  }

 private:
  Mutex mu_;
  bool ended_ ABSL_GUARDED_BY(mu_) = false;
  uint64_t last_id_ ABSL_GUARDED_BY(mu_) = 0;
  std::map<uint64_t, std::function<void()>> ends_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
