#include "server/engine/frame_queue.h"

#include <utility>

namespace clearance {

bool FrameQueue::HasRoom(bool has_points) const {
  if (frames_.size() >= options_.capacity + options_.stripped_capacity) return false;
  if (!has_points || options_.overload == OverloadPolicy::kDropOldestStatic) return true;
  return with_points_ < options_.capacity;
}

void FrameQueue::Push(QueuedFrame frame) {
  if (frame.has_points()) {
    if (with_points_ >= options_.capacity) {
      for (QueuedFrame& waiting : frames_) {
        if (!waiting.has_points()) continue;
        waiting.frame.observation = std::monostate{};
        waiting.stripped = true;
        --with_points_;
        break;
      }
    }
    ++with_points_;
  }
  frames_.push_back(std::move(frame));
}

std::optional<QueuedFrame> FrameQueue::Pop() {
  if (frames_.empty()) return std::nullopt;
  QueuedFrame frame = std::move(frames_.front());
  frames_.pop_front();
  if (frame.has_points()) --with_points_;
  return frame;
}

}  // namespace clearance
