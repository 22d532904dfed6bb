// The gRPC channel to a server. Private to the SDK.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/credentials.h"

namespace clearance::client {

// Connects within `timeout`. UNAVAILABLE naming address, cause and what to do; INVALID_ARGUMENT for
// an address that cannot be one or for half of a key pair; NOT_FOUND for a file that is not there.
absl::StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const std::string& address,
                                                           const Credentials& credentials,
                                                           absl::Duration timeout);

// grpc's error with the server's address where the connection is what failed.
absl::Status CallStatus(const grpc::Status& status, const std::string& address);

}  // namespace clearance::client
