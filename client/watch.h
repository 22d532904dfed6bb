// What a watch of a map tells, without its content: for displays and counters. A mirror
// (client/mirror) keeps the content.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/esdf_client.h"
#include "client/types.h"

namespace clearance::client {

struct WatchOptions {
  std::string map;             // empty: the client's
  std::optional<Aabb> bounds;  // only blocks that touch it
  double max_rate_hz = 0;      // events a second at most; 0 = every revision
  bool poses_only = false;
  absl::Time until = absl::InfiniteFuture();  // then the watch ends, as if the callback said so
};

// A checkpoint or a delta, with all its parts.
struct WatchEvent {
  bool checkpoint = false;
  uint64_t prev_revision = 0;  // of a delta
  MapStamp stamp;              // staleness_s: the age of the newest frame when it was sent
  uint64_t blocks = 0, removed_blocks = 0;
  uint64_t bytes = 0;  // of all messages; block_bytes and object_bytes are most of them
  uint64_t block_bytes = 0, object_bytes = 0;
  std::vector<ObjectBrief> objects;  // new or changed
  uint64_t evicted_objects = 0;
};

// Return false to stop watching.
using WatchCallback = std::function<bool(const WatchEvent&)>;

// Follows a map over a connection of its own until `callback` returns false or the time is up (OK)
// or the stream ends: NOT_FOUND where the map is deleted, UNAVAILABLE where the server stops. No
// timeout.
absl::Status WatchMap(const ClientOptions& client, const WatchOptions& options,
                      const WatchCallback& callback);

}  // namespace clearance::client
