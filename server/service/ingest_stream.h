// One IngestFrames stream: open, frames in, acks and credits out, closing.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "clearance/v1/ingest.pb.h"
#include "server/engine/map_registry.h"
#include "server/service/ingest_sessions.h"
#include "server/service/service_context.h"

namespace clearance {

void ToProto(const FrameAck& ack, v1::FrameAck* out);

// Decodes a frame of one source. The status carries the violations.
absl::StatusOr<Frame> DecodeFrame(const ServiceContext& service, const v1::Frame& frame,
                                  const std::string& source, double max_range_m);

// RESOURCE_EXHAUSTED with RetryInfo: what a frame gets where a memory cap is reached.
absl::Status OverMemoryError(const MappingEngine& engine);

// Thread-safe. The transport, the mapping thread and the drain all push this state machine; only
// one thread at a time acts on the stream (Drive), so nothing is started twice or after the end.
class IngestStream final
    : public grpc::ServerBidiReactor<v1::IngestFramesRequest, v1::IngestFramesResponse>,
      public std::enable_shared_from_this<IngestStream> {
 public:
  // The stream owns itself until the transport is done with it.
  static IngestStream* Start(ServiceContext* service, const grpc::ServerContextBase* context,
                             IngestSessions* sessions);

  // Reads no more; settles what is in flight, sends its acks, then IngestClosing, and ends.
  void Close(v1::IngestClosingReason reason);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  IngestStream(ServiceContext* service, const grpc::ServerContextBase* context,
               IngestSessions* sessions)
      : service_(service), context_(context), sessions_(sessions) {}

  void Drive();
  enum class Step { kNone, kRead, kWrite, kFinish };
  Step NextStep() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);
  void EndWith(absl::Status status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);

  absl::Status OpenFrom(const v1::IngestFramesRequest& request);
  void TakeFrame(const v1::Frame& frame);
  // Hands a frame, or the violations of one that could not be decoded, to the map; waits for room
  // without a thread where the queue is full.
  struct Arrival {
    Frame frame;
    std::string encoded;  // for the log, where there is one
    std::vector<Violation> violations;
  };
  void Admit(std::shared_ptr<Arrival> arrival);
  void OnAck(const FrameAck& ack);
  // Why the map takes no more frames.
  v1::IngestClosingReason ReasonOfEnd() const;
  void Leave();

  ServiceContext* const service_;
  const grpc::ServerContextBase* const context_;  // until OnDone
  IngestSessions* const sessions_;
  std::shared_ptr<IngestStream> self_;  // until OnDone

  // Set by the first message, constant afterwards.
  MapRegistry::EnginePtr engine_;
  std::string source_;
  double max_range_m_ = 0;

  // Used by the transport between a Start and its On...Done.
  v1::IngestFramesRequest request_;
  v1::IngestFramesResponse response_;

  Mutex mu_;
  bool opened_ ABSL_GUARDED_BY(mu_) = false;
  bool driving_ ABSL_GUARDED_BY(mu_) = false;
  bool again_ ABSL_GUARDED_BY(mu_) = false;
  bool want_read_ ABSL_GUARDED_BY(mu_) = true;
  bool writing_ ABSL_GUARDED_BY(mu_) = false;
  bool broken_ ABSL_GUARDED_BY(mu_) = false;  // the client is gone
  bool finished_ ABSL_GUARDED_BY(mu_) = false;
  bool parked_ ABSL_GUARDED_BY(mu_) = false;  // a frame waits for room in the queue
  uint64_t credits_ ABSL_GUARDED_BY(mu_) = 0;
  uint64_t in_flight_ ABSL_GUARDED_BY(mu_) = 0;
  std::deque<v1::IngestFramesResponse> out_ ABSL_GUARDED_BY(mu_);
  std::optional<v1::IngestClosingReason> closing_ ABSL_GUARDED_BY(mu_);
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mu_);  // what to finish with when all is out
};

}  // namespace clearance
