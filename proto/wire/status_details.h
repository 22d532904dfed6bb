// Errors as api users see them: what, where, got and expected, in words and as google.rpc details.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/core/frame.h"

namespace clearance::wire {

// INVALID_ARGUMENT "field[index]: got ...; expected ..." (without [index] where it is negative),
// with a google.rpc.BadRequest payload.
absl::Status InvalidField(std::string_view field, int64_t index, std::string_view got,
                          std::string_view expected);

// The same path below an outer one: "pose" inside "frame" becomes "frame.pose".
std::string Path(std::string_view outer, std::string_view inner);
std::string PathAt(std::string_view outer, std::string_view inner, size_t index);

// Attaches google.rpc.RetryInfo: the caller may try again after `delay`.
absl::Status WithRetry(absl::Status status, absl::Duration delay);
std::optional<absl::Duration> RetryDelayOf(const absl::Status& status);

// The violations that an INVALID_ARGUMENT status carries; one with the status' text and an empty
// field where it carries none. Empty for an OK status. The index is that of the last [index] in
// the field's path.
std::vector<Violation> ViolationsOf(const absl::Status& status);

}  // namespace clearance::wire
