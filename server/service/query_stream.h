// QueryStream: tagged requests in, tagged answers out, as they come.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>

#include "absl/status/status.h"
#include "clearance/v1/query.pb.h"
#include "server/service/service_context.h"

namespace clearance {

// Owns itself until the transport is done with it. Reads while fewer than
// limits.max_stream_requests wait for their answer or for the client to take it.
class QueryStreamCall final
    : public grpc::ServerBidiReactor<v1::QueryStreamRequest, v1::QueryStreamResponse>,
      public std::enable_shared_from_this<QueryStreamCall> {
 public:
  static grpc::ServerBidiReactor<v1::QueryStreamRequest, v1::QueryStreamResponse>* Start(
      ServiceContext* service, const grpc::ServerContextBase* context);
  ~QueryStreamCall() override;

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  ServiceContext* service() const { return service_; }
  // One request's answer, exactly once each.
  void Deliver(v1::QueryStreamResponse response);
  bool closed() const;
  // Runs `hook` when the client goes away, perhaps at once, unless `owner` is forgotten before.
  void WhenCancelled(const void* owner, std::function<void()> hook);
  void Forget(const void* owner);

 private:
  QueryStreamCall(ServiceContext* service, const grpc::ServerContextBase* context);

  void Dispatch(const v1::QueryStreamRequest& request);
  void EndForDrain();
  // What can be done now: write, read on, or finish.
  void Advance();

  ServiceContext* const service_;
  const grpc::ServerContextBase* const context_;  // until OnDone
  const std::chrono::steady_clock::time_point started_at_ = std::chrono::steady_clock::now();
  std::shared_ptr<QueryStreamCall> self_;
  uint64_t open_id_ = 0;
  v1::QueryStreamRequest request_;    // of the read under way
  v1::QueryStreamResponse response_;  // of the write under way
  mutable Mutex mu_;
  bool reading_ ABSL_GUARDED_BY(mu_) = false;
  bool writing_ ABSL_GUARDED_BY(mu_) = false;
  bool no_more_ ABSL_GUARDED_BY(mu_) = false;  // the client half-closed, or a drain
  bool cancelled_ ABSL_GUARDED_BY(mu_) = false;
  bool finished_ ABSL_GUARDED_BY(mu_) = false;
  absl::Status outcome_ ABSL_GUARDED_BY(mu_);
  size_t in_work_ ABSL_GUARDED_BY(mu_) = 0;
  std::deque<v1::QueryStreamResponse> answers_ ABSL_GUARDED_BY(mu_);
  std::map<const void*, std::function<void()>> hooks_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
