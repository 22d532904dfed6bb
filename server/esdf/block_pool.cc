#include "server/esdf/block_pool.h"

#include <utility>

namespace clearance {

std::shared_ptr<FieldBlock> BlockPool::Take() {
  while (!free_.empty()) {
    std::shared_ptr<FieldBlock> block = std::move(free_.back());
    free_.pop_back();
    if (block.use_count() > 1) continue;  // a reader still holds this one: leave it to them
    // The last reader let go in its own thread: an acquiring operation on the count orders its
    // reads before our writes, which use_count() does not.
    std::shared_ptr<FieldBlock>(block).reset();
    return block;
  }
  return std::make_shared<FieldBlock>();
}

void BlockPool::NextGeneration() {
  if (!current_.empty()) waiting_.push_back(std::move(current_));
  current_.clear();
  // One field shows or hides a generation as a whole, so its first block speaks for all; Take()
  // looks at each again.
  while (!waiting_.empty() && waiting_.front().front().use_count() == 1) {
    for (auto& block : waiting_.front()) {
      if (free_.size() < kMaxFree) free_.push_back(std::move(block));
    }
    waiting_.pop_front();
  }
  while (waiting_.size() > kMaxGenerations) waiting_.pop_front();
}

size_t BlockPool::size() const {
  size_t count = free_.size() + current_.size();
  for (const auto& generation : waiting_) count += generation.size();
  return count;
}

}  // namespace clearance
