#include "server/integration/ray_counts.h"

#include <algorithm>

namespace clearance {
namespace {

BlockIndex Plus(const BlockIndex& a, const BlockIndex& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
BlockIndex Minus(const BlockIndex& a, const BlockIndex& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

}  // namespace

RayCounts::Block* RayCounts::Find(const BlockIndex& relative) {
  Slot& slot = cache_[((relative.x & 31) << 9) | ((relative.y & 31) << 4) | (relative.z & 15)];
  if (slot.block && slot.index == relative) return slot.block;
  std::unique_ptr<Block>& block = blocks_[relative];
  if (!block) {
    block = std::make_unique<Block>();
    block->stored = StoredSurface(*map_, Plus(relative, base_));
    if (!block->stored.empty()) block->held = block->stored.HeldVoxels();
  }
  slot = {relative, block.get()};
  return block.get();
}

std::vector<BlockIndex> RayCounts::Blocks(const std::vector<const RayCounts*>& threads) {
  std::vector<BlockIndex> all;
  for (const RayCounts* t : threads) {
    for (const auto& [relative, block] : t->blocks_) all.push_back(Plus(relative, t->base_));
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

int RayCounts::Passed(const std::vector<const RayCounts*>& threads, const VoxelIndex& v) {
  int passed = 0;
  for (const RayCounts* t : threads) {
    const auto it = t->blocks_.find(Minus(BlockOf(v), t->base_));
    if (it != t->blocks_.end()) passed += it->second->passed[OffsetOf(v)];
  }
  return passed;
}

RayCounts::Block RayCounts::Sum(const std::vector<const RayCounts*>& threads,
                                const BlockIndex& block) {
  Block sum;
  for (const RayCounts* t : threads) {
    const auto it = t->blocks_.find(Minus(block, t->base_));
    if (it == t->blocks_.end()) continue;
    const Block& part = *it->second;
    for (int o = 0; o < kBlockVoxels; ++o) {
      sum.passed[o] = static_cast<uint8_t>(std::min(255, sum.passed[o] + part.passed[o]));
      sum.refuted[o] = static_cast<uint8_t>(std::min(255, sum.refuted[o] + part.refuted[o]));
      sum.doubted[o] = static_cast<uint8_t>(std::min(255, sum.doubted[o] + part.doubted[o]));
    }
    sum.held = part.held;
    sum.stored = part.stored;
  }
  return sum;
}

}  // namespace clearance
