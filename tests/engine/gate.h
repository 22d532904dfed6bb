// Holds a thread at a place until the test lets it go; a test that forgets does not hang for ever.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>

namespace clearance {

class Gate {
 public:
  // Blocks while closed.
  void Pass() {
    std::unique_lock lock(mu_);
    ++arrived_;
    changed_.notify_all();
    changed_.wait_for(lock, std::chrono::seconds(60), [this] { return open_; });
  }
  void WaitForArrival(int count = 1) {
    std::unique_lock lock(mu_);
    changed_.wait_for(lock, std::chrono::seconds(60), [&] { return arrived_ >= count; });
  }
  void Open() {
    std::lock_guard lock(mu_);
    open_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mu_;
  std::condition_variable changed_;
  int arrived_ = 0;
  bool open_ = false;
};

}  // namespace clearance
