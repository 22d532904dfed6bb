// One source's frames on their way into a map, across cut connections.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/types.h"

namespace clearance::client {

enum class AckStatus { kUnspecified, kAccepted, kIntegrated, kDuplicate, kDropped, kRejected };

struct FrameAck {
  uint64_t frame_id = 0;
  AckStatus status = AckStatus::kUnspecified;
  MapStamp stamp;
  std::vector<Violation> violations;
  double queue_ms = 0;
  double integrate_ms = 0;
};

struct IngestOptions {
  std::string map;         // empty: the client's
  std::string source_id;   // empty is `default`
  double max_range_m = 0;  // 0: the map's limit
  // Without any word from the server for this long the connection counts as lost.
  absl::Duration stall_timeout = absl::Seconds(60);
  // A lost connection is retried for this long, with growing, jittered pauses.
  absl::Duration reconnect_for = absl::Seconds(30);
  absl::Duration min_backoff = absl::Milliseconds(100);
  absl::Duration max_backoff = absl::Seconds(5);
  // Called on a thread of the stream, in the order of the acks. Must not call the stream.
  std::function<void(const FrameAck&)> on_ack;
};

// Sends frames as credits allow. When the connection breaks or the server drains, the stream opens
// a new one, learns where the server stands and sends what is not settled again; nothing is sent
// twice to effect. One thread sends.
class IngestStream {
 public:
  virtual ~IngestStream() = default;

  // The newest frame of this source that was settled when the stream was (re)opened or since;
  // absent where there is none. Continue behind it.
  virtual std::optional<uint64_t> last_frame_id() const = 0;
  virtual uint64_t reconnects() const = 0;

  // Queues the frame, waiting for credit. Frame ids rise. Errors: what ended the stream for good:
  // UNAVAILABLE when reconnecting failed, DEADLINE_EXCEEDED when the server stopped answering,
  // ABORTED where the server lost frames that it had settled (its map was restored or made anew):
  // open again and continue behind last_frame_id(). Others as the server's.
  virtual absl::Status Send(const Frame& frame) = 0;

  // Waits until every frame is settled and closes the stream.
  virtual absl::Status Finish() = 0;
};

}  // namespace clearance::client
