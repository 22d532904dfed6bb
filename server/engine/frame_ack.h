// What becomes of a frame, and which state of the map an answer speaks of.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <vector>

#include "server/core/frame.h"
#include "server/map/map_view.h"

namespace clearance {

// The identity of one published view, without its content.
struct RevisionStamp {
  uint64_t revision = 0;
  uint64_t field_revision = 0;
  uint64_t epoch = 0;
  int64_t stamp_ns = 0;
  std::chrono::steady_clock::time_point published_at;
};

inline RevisionStamp StampOf(const MapView& view) {
  return {view.revision, view.field_revision, view.epoch, view.stamp_ns, view.published_at};
}

struct FrameAck {
  enum class Status {
    kAccepted,    // durable; another ack follows
    kIntegrated,  // visible at `stamp`
    kDuplicate,   // settled before; `stamp` is its first one
    kDropped,     // by the overload policy: the points are lost, poses and motions are not
    kRejected,    // malformed; the map is untouched
    kAbandoned,   // the map stopped first: not settled, send it again
  };
  uint64_t frame_id = 0;
  Status status = Status::kIntegrated;
  RevisionStamp stamp;
  std::vector<Violation> violations;
  double queue_ms = 0;
  double integrate_ms = 0;

  bool settles() const { return status != Status::kAccepted && status != Status::kAbandoned; }
};

// Called on the mapping thread or inside Submit; must not block.
using FrameCallback = std::function<void(const FrameAck&)>;

}  // namespace clearance
