// Reactors that end a call at once with an error.
#pragma once

#include <grpcpp/support/server_callback.h>

#include "absl/status/status.h"
#include "proto/wire/grpc_status.h"

namespace clearance {

inline grpc::ServerUnaryReactor* RefuseUnary(grpc::CallbackServerContext* context,
                                             const absl::Status& status) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(wire::ToGrpcStatus(status));
  return reactor;
}

template <typename Response>
grpc::ServerWriteReactor<Response>* RefuseWrites(const absl::Status& status) {
  class Reactor : public grpc::ServerWriteReactor<Response> {
   public:
    explicit Reactor(const absl::Status& status) { this->Finish(wire::ToGrpcStatus(status)); }
    void OnDone() override { delete this; }
  };
  return new Reactor(status);
}

template <typename Request, typename Response>
grpc::ServerBidiReactor<Request, Response>* RefuseStream(const absl::Status& status) {
  class Reactor : public grpc::ServerBidiReactor<Request, Response> {
   public:
    explicit Reactor(const absl::Status& status) { this->Finish(wire::ToGrpcStatus(status)); }
    void OnDone() override { delete this; }
  };
  return new Reactor(status);
}

}  // namespace clearance
