// Frames on their way to the mapping thread, bounded.
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "server/core/frame.h"
#include "server/engine/frame_ack.h"
#include "server/map/map_config.h"

namespace clearance {

struct QueuedFrame {
  Frame frame;
  std::string encoded;                // as it goes to the log; empty where there is none
  std::vector<Violation> rejections;  // not empty: settles as REJECTED when its turn comes
  FrameCallback done;
  std::chrono::steady_clock::time_point queued_at;
  bool stripped = false;  // lost its points to the overload policy

  bool has_points() const {
    return rejections.empty() && !std::holds_alternative<std::monostate>(frame.observation);
  }
};

struct FrameQueueOptions {
  size_t capacity = 8;              // frames with points
  size_t stripped_capacity = 1024;  // frames without: poses and motions only
  OverloadPolicy overload = OverloadPolicy::kBlock;
};

// First in, first out. Not thread-safe; the engine locks.
class FrameQueue {
 public:
  explicit FrameQueue(const FrameQueueOptions& options) : options_(options) {}

  // Whether Push takes one more frame of this kind. With kDropOldestStatic a frame with points
  // always finds room while the queue of stripped frames is not full.
  bool HasRoom(bool has_points) const;
  // Requires HasRoom. May take the points of the oldest waiting frame that has some.
  void Push(QueuedFrame frame);
  std::optional<QueuedFrame> Pop();

  size_t size() const { return frames_.size(); }
  size_t capacity() const { return options_.capacity; }

 private:
  FrameQueueOptions options_;
  std::deque<QueuedFrame> frames_;
  size_t with_points_ = 0;
};

}  // namespace clearance
