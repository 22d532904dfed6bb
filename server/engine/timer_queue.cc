#include "server/engine/timer_queue.h"

namespace clearance {

TimerQueue::TimerQueue() : thread_([this] { Run(); }) {}

TimerQueue::~TimerQueue() {
  {
    MutexLock lock(&mu_);
    stopping_ = true;
    changed_.NotifyAll();
  }
  thread_.join();
}

uint64_t TimerQueue::Schedule(Clock::time_point when, std::function<void()> callback) {
  MutexLock lock(&mu_);
  const uint64_t id = next_id_++;
  due_.emplace(std::make_pair(when, id), std::move(callback));
  when_.emplace(id, when);
  changed_.NotifyAll();
  return id;
}

bool TimerQueue::Cancel(uint64_t id) {
  MutexLock lock(&mu_);
  const auto it = when_.find(id);
  if (it == when_.end()) return false;
  due_.erase({it->second, id});
  when_.erase(it);
  return true;
}

void TimerQueue::Run() {
  mu_.Lock();
  while (!stopping_) {
    if (due_.empty()) {
      changed_.Wait(&mu_);
      continue;
    }
    const auto first = due_.begin();
    const Clock::time_point when = first->first.first;
    if (Clock::now() < when) {
      changed_.WaitUntil(&mu_, when);
      continue;
    }
    std::function<void()> callback = std::move(first->second);
    when_.erase(first->first.second);
    due_.erase(first);
    mu_.Unlock();
    callback();
    callback = nullptr;  // destroyed without the lock: it may own whatever the caller gave it
    mu_.Lock();
  }
  mu_.Unlock();
}

}  // namespace clearance
