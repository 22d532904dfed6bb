// Collects acks and waits for them.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <vector>

#include "server/engine/frame_ack.h"

namespace clearance {

class AckLog {
 public:
  FrameCallback Callback() {
    return [this](const FrameAck& ack) {
      std::lock_guard lock(mu_);
      acks_.push_back(ack);
      changed_.notify_all();
    };
  }
  // All acks so far, once there are `count`.
  std::vector<FrameAck> Wait(size_t count) {
    std::unique_lock lock(mu_);
    changed_.wait_for(lock, std::chrono::seconds(60), [&] { return acks_.size() >= count; });
    return acks_;
  }

 private:
  std::mutex mu_;
  std::condition_variable changed_;
  std::vector<FrameAck> acks_;
};

}  // namespace clearance
