// One open IngestFrames call: opens, counts credits, reads acks. Private to the SDK.
#pragma once

#include <grpcpp/client_context.h>

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "clearance/v1/ingest.grpc.pb.h"

namespace clearance::client {

// Created, used and destroyed by one thread; a thread of its own reads.
class IngestSession {
 public:
  using OnAck = std::function<void(const v1::FrameAck&)>;

  // Sends `open` and waits for `opened`.
  static absl::StatusOr<std::unique_ptr<IngestSession>> Open(v1::IngestService::Stub& stub,
                                                             const v1::OpenIngest& open,
                                                             const std::string& address,
                                                             absl::Duration stall_timeout,
                                                             OnAck on_ack);
  ~IngestSession();

  std::optional<uint64_t> opened_last_frame_id() const { return opened_last_frame_id_; }

  // Waits for credit and writes. UNAVAILABLE where the stream ended and may be opened again.
  absl::Status Write(const v1::IngestFramesRequest& request);

  // Waits until `done` says so, checked after every ack.
  absl::Status AwaitAcks(const std::function<bool()>& done);

  // Half-closes and returns the call's end.
  absl::Status Finish();

 private:
  IngestSession(std::string address, absl::Duration stall_timeout, OnAck on_ack)
      : address_(std::move(address)), stall_timeout_(stall_timeout), on_ack_(std::move(on_ack)) {}

  void Read();
  absl::Status Ended() ABSL_LOCKS_EXCLUDED(mutex_);
  // Waits for `condition`, the stream's end or silence; false where the stream ended.
  absl::Status Await(const std::function<bool()>& condition) ABSL_LOCKS_EXCLUDED(mutex_);

  const std::string address_;
  const absl::Duration stall_timeout_;
  const OnAck on_ack_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::IngestFramesRequest, v1::IngestFramesResponse>>
      stream_;
  std::optional<uint64_t> opened_last_frame_id_;
  bool finished_ = false;
  absl::Status final_status_;

  absl::Mutex mutex_;
  absl::CondVar changed_;
  uint64_t credits_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t messages_ ABSL_GUARDED_BY(mutex_) = 0;  // received: shows that the server lives
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<v1::IngestClosing> closing_ ABSL_GUARDED_BY(mutex_);
  std::thread reader_;
};

}  // namespace clearance::client
