// What changed in a map after a revision: what a reader that stands there lacks.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "server/map/map_view.h"

namespace clearance {

// An object and its generation.
using ObjectKey = std::pair<ObjectId, uint32_t>;

// Follows the published views of one epoch and remembers, by block and by surface, in which
// revision it changed last: numbers, not voxels, so a reader may lag or come back as late as it
// likes and holds nothing in memory. Views share what did not change, so following them costs the
// comparison of pointers. Not thread-safe.
class ChangeLog {
 public:
  explicit ChangeLog(std::shared_ptr<const MapView> first);

  // Takes a newer view of the same epoch; anything else is ignored. Revisions in between need not
  // be shown.
  void Advance(std::shared_ptr<const MapView> next);

  const std::shared_ptr<const MapView>& newest() const { return newest_; }
  // The view shown before the newest; nullptr at first.
  const std::shared_ptr<const MapView>& previous() const { return previous_; }

  struct Changes {
    std::vector<BlockIndex> blocks;  // sorted; those that are gone by now included
    std::vector<ObjectKey> surfaces;
    std::vector<ObjectKey> evicted;
  };
  // From `revision` to the newest. nullopt where it is not between the first view and the newest.
  std::optional<Changes> Since(uint64_t revision) const;

  // Numbers kept, for the curious.
  size_t size() const { return changed_in_.size() + journaled_; }

 private:
  struct Entry {
    uint64_t revision;
    std::vector<BlockIndex> blocks;
  };

  uint64_t first_revision_;
  std::shared_ptr<const MapView> newest_, previous_;
  absl::flat_hash_map<BlockIndex, uint64_t> changed_in_;
  std::deque<Entry> journal_;  // the same by revision, newest last; old entries are dropped
  size_t journaled_ = 0;       // blocks in the journal
  std::map<ObjectKey, uint64_t> surface_in_;
  std::map<ObjectKey, uint64_t> evicted_in_;
};

}  // namespace clearance
