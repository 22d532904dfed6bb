// From the messages of a watch to views of the map: pure, no threads, no connection.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "clearance/v1/watch.pb.h"
#include "server/map/map_view.h"

namespace clearance::client {

struct ViewLimits {
  uint64_t max_memory_bytes = uint64_t{8} << 30;  // of a view's blocks and sites
  uint64_t max_objects = 65536;
};

// Trusts nothing that a message says. After an error it stands where the last complete view is, and
// the watch must be started anew.
class ViewBuilder {
 public:
  using ViewPtr = std::shared_ptr<const MapView>;

  explicit ViewBuilder(ViewLimits limits = {}) : limits_(limits) {}

  // Answers that are older than this are stale; absent: as the server says.
  void set_stale_after_s(std::optional<double> seconds) { stale_after_s_ = seconds; }

  // Takes the next message. The new view when it completes one, nullptr when more is to come.
  // DATA_LOSS or INVALID_ARGUMENT for damaged content, FAILED_PRECONDITION for a gap in the chain
  // or another format, RESOURCE_EXHAUSTED beyond the limits.
  absl::StatusOr<ViewPtr> Take(const v1::WatchMapResponse& message);

  // The last complete view; nullptr at first.
  const ViewPtr& current() const { return current_; }
  // Forgets what an unfinished message began: the connection is gone.
  void Interrupt();

 private:
  using ObjectKey = std::pair<ObjectId, uint32_t>;

  absl::StatusOr<ViewPtr> TakePart(const v1::WatchMapResponse& message);
  absl::Status TakeHello(const v1::WatchHello& hello);
  absl::Status Begin(bool checkpoint, uint64_t prev_revision);
  template <typename Part>
  absl::Status TakeContent(const Part& part, bool is_checkpoint);
  absl::Status TakeBlocks(const v1::FieldBlocks& blocks);
  absl::Status TakeObject(const v1::ObjectState& state);
  absl::Status TakeSurface(const ObjectKey& key, const v1::ObjectSurface& surface);
  absl::Status FinishSurfaces();
  absl::StatusOr<ViewPtr> Finish(const v1::MapStamp& stamp);
  absl::Status Charge(uint64_t bytes);
  void Refund(uint64_t bytes);

  const ViewLimits limits_;
  std::optional<double> stale_after_s_;
  std::optional<MapConfig> config_;  // of the epoch that hello announced
  uint64_t epoch_ = 0;
  bool resumes_ = false;
  ViewPtr current_;

  // The view being told.
  std::optional<MapView> working_;
  bool working_checkpoint_ = false;
  uint64_t working_prev_ = 0, working_revision_ = 0;
  uint32_t next_part_ = 0;
  std::map<ObjectKey, ObjectView> objects_;
  struct PendingSurface {
    uint64_t site_count = 0;
    std::vector<SurfaceSite> sites;
  };
  std::map<ObjectKey, PendingSurface> surfaces_;
  uint64_t memory_bytes_ = 0;          // of the view being told, blocks and sites
  uint64_t current_memory_bytes_ = 0;  // of current_
};

}  // namespace clearance::client
