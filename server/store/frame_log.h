// The durable sequence of what changed a map: opaque records, numbered without gaps.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace clearance {

struct LogStats {
  uint64_t first_index = 0;  // oldest record that is kept
  uint64_t last_index = 0;   // newest; first_index - 1 when there is none
  uint64_t segments = 0;
  uint64_t bytes = 0;
  uint64_t appended = 0;  // since the start
  uint64_t failed = 0;    // appends that were refused, since the start
  uint64_t syncs = 0;
};

// Local files here, or a broker's stream behind the same five calls. Thread-safe; one thread
// appends at a time.
class FrameLog {
 public:
  virtual ~FrameLog() = default;

  // Returns the record's index once it is as durable as the log promises. An error means that
  // nothing was written: RESOURCE_EXHAUSTED where there is no room (a later append may succeed),
  // else the log is broken until it is opened again.
  // The record is `head` and `body`, joined.
  virtual absl::StatusOr<uint64_t> Append(std::string_view head, std::string_view body) = 0;

  // Everything appended so far reaches the disk.
  virtual absl::Status Sync() = 0;

  // Calls `visit` for every record behind `after`, in order, and stops at its first error.
  // DATA_LOSS naming the place where records are damaged or missing.
  using Visitor = std::function<absl::Status(uint64_t index, std::string_view record)>;
  virtual absl::Status Replay(uint64_t after, const Visitor& visit) = 0;

  // Records up to `index` are not needed any more and may be deleted.
  virtual void Forget(uint64_t index) = 0;

  virtual LogStats Stats() const = 0;
};

}  // namespace clearance
