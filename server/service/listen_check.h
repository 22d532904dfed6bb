// Whether an address can be bound, with the reason where not: gRPC only says no.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace clearance {

// UNAVAILABLE naming address and reason; INVALID_ARGUMENT for a host that does not resolve.
absl::Status CheckTcpAddress(const std::string& host, int port);
// Also removes the socket of a server that is gone. UNAVAILABLE where a server answers there,
// FAILED_PRECONDITION where the path is something else.
absl::Status CheckUnixSocket(const std::string& path);

}  // namespace clearance
