// A line for each call that ends, and an id that client and server both know it by.
#pragma once

#include <grpcpp/support/server_interceptor.h>

#include <memory>
#include <string>
#include <string_view>

namespace clearance {

enum class CallLogging { kNone, kFailed, kAll };

inline constexpr char kRequestIdKey[] = "x-request-id";

// Whether a client's id is taken: 1 to 64 letters, digits and . _ : -, so that no log line is
// forged.
bool IsRequestId(std::string_view id);

// For every RPC of the server, streams, health and reflection included. The id is the client's
// x-request-id, or is made here, and stands in the trailing metadata. Logged are method, code,
// message, milliseconds, peer and id, never metadata: tokens are there. Of failed calls at most
// `max_failed_per_s` leave a line a second; the next line says how many did not.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> CallLogFactory(
    CallLogging logging, int max_failed_per_s = 50);

}  // namespace clearance
