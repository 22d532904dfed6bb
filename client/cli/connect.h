// Where and as whom a command connects, for those that need more than Context::Connect.
#pragma once

#include "absl/status/statusor.h"
#include "client/cli/context.h"

namespace clearance::cli {

// NOT_FOUND for a token file that cannot be read.
absl::StatusOr<client::ClientOptions> ClientOptionsOf(const Context& context);

}  // namespace clearance::cli
