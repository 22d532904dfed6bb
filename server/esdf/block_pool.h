// Memory of field blocks that no published field shows any more, for reuse.
#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "server/map/distance_field.h"

namespace clearance {

// Blocks are handed in as they are replaced. Readers of older fields may hold them for a while
// longer; once they let go, the block is taken again instead of fresh memory. Single-threaded; the
// readers may be in other threads.
class BlockPool {
 public:
  // A block with unspecified content that nobody else refers to.
  std::shared_ptr<FieldBlock> Take();
  // Hands in a block that published fields may still show.
  void Retire(std::shared_ptr<FieldBlock> block) { current_.push_back(std::move(block)); }
  // Ends a generation: blocks retired since the last call were replaced together.
  void NextGeneration();

  size_t size() const;
  // Gives free blocks back to the system.
  void ReleaseSpare() { free_ = {}; }

 private:
  // Readers that pin an old revision keep its generation back; no more than this many wait.
  static constexpr size_t kMaxGenerations = 12;
  static constexpr size_t kMaxFree = 4096;

  std::vector<std::shared_ptr<FieldBlock>> free_;
  std::vector<std::shared_ptr<FieldBlock>> current_;
  std::deque<std::vector<std::shared_ptr<FieldBlock>>> waiting_;
};

}  // namespace clearance
