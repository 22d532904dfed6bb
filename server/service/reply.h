// Where the answer to one request goes: a call of its own, or a place in a stream.
#pragma once

#include <functional>

#include "absl/status/statusor.h"

namespace clearance {

// Shared by the transport and whoever works on the answer. Thread-safe.
template <typename Response>
class Reply {
 public:
  virtual ~Reply() = default;

  // The first one counts; after a cancellation none does.
  virtual void Finish(absl::StatusOr<Response> result) = 0;
  // Whether an answer would still reach anyone.
  virtual bool done() const = 0;
  // Runs `hook` once if the client goes away before Finish, perhaps at once.
  virtual void WhenCancelled(std::function<void()> hook) = 0;
};

}  // namespace clearance
