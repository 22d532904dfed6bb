// Reactors of RPCs that the contract declares and this server does not offer yet.
#pragma once

#include <grpcpp/support/server_callback.h>

#include "absl/strings/str_format.h"

namespace clearance {

inline grpc::Status NotOffered(const char* method) {
  return {grpc::StatusCode::UNIMPLEMENTED,
          absl::StrFormat("%s is part of clearance.v1, but this server does not offer it yet; see "
                          "AdminService/GetServerInfo for its version",
                          method)};
}

inline grpc::ServerUnaryReactor* UnaryNotOffered(grpc::CallbackServerContext* context,
                                                 const char* method) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(NotOffered(method));
  return reactor;
}

}  // namespace clearance
