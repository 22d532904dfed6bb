// absl::Status <-> grpc::Status, payloads included (as google.rpc.Status details).
#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace clearance::wire {

// Details beyond 2 KiB are left out: trailers share the metadata limit of 8 KiB.
grpc::Status ToGrpcStatus(const absl::Status& status);
absl::Status FromGrpcStatus(const grpc::Status& status);

}  // namespace clearance::wire
