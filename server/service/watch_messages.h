// What a watcher is sent: everything, or what changed, in parts below the message limit.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "clearance/v1/watch.pb.h"
#include "server/engine/change_log.h"
#include "server/engine/mapping_engine.h"

namespace clearance {

// What of a map a watcher wants.
struct WatchSelection {
  std::optional<Aabb> bounds;  // blocks that touch it
  bool poses_only = false;     // neither blocks nor surfaces

  bool everything() const { return !bounds && !poses_only; }
};

void FillHello(const MappingEngine& engine, bool resumes, v1::WatchHello* hello);

// Makes one part at a time, so that a slow reader costs the memory of one part and of the view that
// it is being told.
class WatchMessages {
 public:
  static WatchMessages Checkpoint(ViewPtr view, const WatchSelection& selection);
  // From `revision`, which the log must reach back to, to the log's newest view.
  static WatchMessages Delta(const ChangeLog& log, uint64_t revision,
                             const WatchSelection& selection);

  // The next part; false after the last.
  bool Next(v1::WatchMapResponse* message);
  uint64_t revision() const { return view_->revision; }

 private:
  explicit WatchMessages(ViewPtr view) : view_(std::move(view)) {}

  bool Wanted(const BlockIndex& block, const WatchSelection& selection) const;
  void FillBlocks(size_t* budget, v1::FieldBlocks* out);
  // Returns false where the surface goes on in the next part.
  bool FillObject(size_t* budget, v1::ObjectState* out);

  ViewPtr view_;
  ViewPtr before_;  // what the reader has, where it is at hand
  bool checkpoint_ = false;
  uint64_t prev_revision_ = 0;
  std::vector<BlockIndex> blocks_;
  struct Object {
    const ObjectView* view;  // in view_
    bool with_surface;
  };
  std::vector<Object> objects_;
  std::vector<ObjectKey> evicted_;
  size_t next_block_ = 0, next_object_ = 0, next_site_ = 0;
  uint32_t part_ = 0;
  bool done_ = false;
};

}  // namespace clearance
