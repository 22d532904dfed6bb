#include "server/store/flusher.h"

#include <utility>

namespace clearance {

Flusher::Flusher(std::chrono::milliseconds period) : period_(period), thread_([this] { Run(); }) {}

Flusher::~Flusher() {
  {
    std::lock_guard lock(mu_);
    stopping_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

uint64_t Flusher::Add(std::function<void()> flush) {
  std::lock_guard lock(mu_);
  entries_.emplace(next_id_, std::move(flush));
  return next_id_++;
}

void Flusher::Remove(uint64_t id) {
  std::unique_lock lock(mu_);
  changed_.wait(lock, [&] { return running_ != id; });
  entries_.erase(id);
}

void Flusher::Run() {
  std::unique_lock lock(mu_);
  while (!changed_.wait_for(lock, period_, [this] { return stopping_; })) {
    for (auto it = entries_.begin(); it != entries_.end();) {
      running_ = it->first;
      const std::function<void()> flush = it->second;
      lock.unlock();
      flush();
      lock.lock();
      it = entries_.upper_bound(running_);
      running_ = 0;
      changed_.notify_all();
    }
  }
}

}  // namespace clearance
