#include "server/engine/change_log.h"

#include <algorithm>

#include "server/map/field_differences.h"

namespace clearance {
namespace {

// The journal may repeat blocks, up to this many times what the table holds.
constexpr size_t kJournalFactor = 2;
constexpr size_t kJournalBlocks = 65536;  // and this many more
constexpr size_t kEvicted = 4096;         // objects remembered that are gone

}  // namespace

ChangeLog::ChangeLog(std::shared_ptr<const MapView> first)
    : first_revision_(first->revision), newest_(std::move(first)) {}

void ChangeLog::Advance(std::shared_ptr<const MapView> next) {
  if (next->epoch != newest_->epoch || next->revision <= newest_->revision) return;
  previous_ = std::move(newest_);
  newest_ = std::move(next);
  const uint64_t revision = newest_->revision;
  Entry entry{revision, {}};
  for (const auto& difference : DifferencesBetween(previous_->field, newest_->field)) {
    changed_in_[difference.index] = revision;
    entry.blocks.push_back(difference.index);
  }
  journaled_ += entry.blocks.size();
  journal_.push_back(std::move(entry));
  while (journaled_ > kJournalFactor * changed_in_.size() + kJournalBlocks) {
    journaled_ -= journal_.front().blocks.size();
    journal_.pop_front();
  }

  std::map<ObjectKey, const ObjectShape*> before;
  for (const ObjectView& object : previous_->objects) {
    before.emplace(ObjectKey(object.id, object.generation), object.shape.get());
  }
  for (const ObjectView& object : newest_->objects) {
    const ObjectKey key(object.id, object.generation);
    const auto it = before.find(key);
    const bool same = it != before.end() && it->second == object.shape.get();
    if (!same) surface_in_[key] = revision;
    if (it != before.end()) before.erase(it);
  }
  for (const auto& [key, shape] : before) {
    evicted_in_[key] = revision;
    surface_in_.erase(key);
  }
  // Nobody from before the oldest eviction that is forgotten can be told any more.
  while (evicted_in_.size() > kEvicted) {
    const auto oldest =
        std::min_element(evicted_in_.begin(), evicted_in_.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    first_revision_ = std::max(first_revision_, oldest->second);
    evicted_in_.erase(oldest);
  }
}

std::optional<ChangeLog::Changes> ChangeLog::Since(uint64_t revision) const {
  if (revision < first_revision_ || revision > newest_->revision) return std::nullopt;
  Changes changes;
  if (!journal_.empty() && journal_.front().revision <= revision + 1) {
    for (auto entry = journal_.rbegin(); entry != journal_.rend(); ++entry) {
      if (entry->revision <= revision) break;
      for (const BlockIndex& block : entry->blocks) {
        // Listed where it changed last, so that it counts once.
        if (changed_in_.at(block) == entry->revision) changes.blocks.push_back(block);
      }
    }
  } else {
    for (const auto& [block, changed_in] : changed_in_) {
      if (changed_in > revision) changes.blocks.push_back(block);
    }
  }
  std::sort(changes.blocks.begin(), changes.blocks.end());
  for (const auto& [key, changed_in] : surface_in_) {
    if (changed_in > revision) changes.surfaces.push_back(key);
  }
  for (const auto& [key, evicted_in] : evicted_in_) {
    if (evicted_in > revision) changes.evicted.push_back(key);
  }
  return changes;
}

}  // namespace clearance
