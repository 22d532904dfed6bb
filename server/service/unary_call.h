// One unary call, answered now or later, exactly once.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <utility>

#include "absl/status/statusor.h"
#include "proto/wire/grpc_status.h"
#include "server/engine/mutex.h"
#include "server/service/reply.h"
#include "server/service/service_context.h"

namespace clearance {

// Shared by the transport and whoever works on the answer. The first of Finish and the client's
// cancellation ends the call; the other then does nothing. Thread-safe.
template <typename Response>
class UnaryCall final : public Reply<Response> {
 public:
  static std::shared_ptr<UnaryCall> Start(ServiceContext* service, const char* method,
                                          Response* response) {
    std::shared_ptr<UnaryCall> call(new UnaryCall(service, method, response));
    auto* reactor = new Reactor(call);
    call->returned_ = reactor;
    call->reactor_.store(reactor);
    return call;
  }

  // What the handler returns to the transport.
  grpc::ServerUnaryReactor* reactor() const { return returned_; }

  bool done() const override { return reactor_.load() == nullptr; }

  void Finish(absl::StatusOr<Response> result) override {
    grpc::ServerUnaryReactor* reactor = reactor_.exchange(nullptr);
    if (reactor == nullptr) return;
    if (result.ok()) *response_ = *std::move(result);
    Record(result.status().code());
    reactor->Finish(wire::ToGrpcStatus(result.status()));
  }

  // Runs `hook` once if the client goes away before Finish, perhaps at once.
  void WhenCancelled(std::function<void()> hook) override {
    {
      MutexLock lock(&mu_);
      if (!cancelled_) {
        hook_ = std::move(hook);
        return;
      }
    }
    hook();
  }

 private:
  class Reactor : public grpc::ServerUnaryReactor {
   public:
    explicit Reactor(std::shared_ptr<UnaryCall> call) : call_(std::move(call)) {}
    void OnCancel() override { call_->Cancel(); }
    void OnDone() override { delete this; }

   private:
    const std::shared_ptr<UnaryCall> call_;
  };

  UnaryCall(ServiceContext* service, const char* method, Response* response)
      : service_(service), method_(method), response_(response) {}

  void Cancel() {
    std::function<void()> hook;
    {
      MutexLock lock(&mu_);
      cancelled_ = true;
      hook.swap(hook_);
    }
    if (hook) hook();
    Finish(absl::CancelledError("the client cancelled or its deadline passed"));
  }

  void Record(absl::StatusCode code) {
    const double ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started_at_)
            .count();
    service_->calls.Record(method_, code, ms);
  }

  ServiceContext* const service_;
  const char* const method_;
  Response* const response_;
  const std::chrono::steady_clock::time_point started_at_ = std::chrono::steady_clock::now();
  grpc::ServerUnaryReactor* returned_ = nullptr;
  std::atomic<grpc::ServerUnaryReactor*> reactor_ = nullptr;
  Mutex mu_;
  bool cancelled_ ABSL_GUARDED_BY(mu_) = false;
  std::function<void()> hook_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
