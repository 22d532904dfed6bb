// One WatchMap stream, moved by the hub's thread.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "clearance/v1/watch.pb.h"
#include "server/service/service_context.h"
#include "server/service/watch_messages.h"

namespace clearance {

// What a stream was asked for, checked.
struct WatchRequest {
  std::string map;
  uint64_t epoch = 0, revision = 0;  // resume behind this; epoch 0: from a checkpoint
  WatchSelection selection;
  double max_rate_hz = 0;  // 0: every revision
};

// INVALID_ARGUMENT naming the field: a bad map id or box, a rate that is not finite or negative.
absl::StatusOr<WatchRequest> WatchRequestFromProto(const v1::WatchMapRequest& request);

// The transport's callbacks only say that something happened; everything else is called by the
// hub's thread alone.
class WatchStream final : public grpc::ServerWriteReactor<v1::WatchMapResponse>,
                          public std::enable_shared_from_this<WatchStream> {
 public:
  using Clock = std::chrono::steady_clock;
  using Message = std::shared_ptr<const v1::WatchMapResponse>;

  // Owns itself until the transport is done with it. `ready` is called whenever the stream may go
  // on.
  static std::shared_ptr<WatchStream> Start(
      ServiceContext* service, WatchRequest request,
      std::function<void(std::shared_ptr<WatchStream>)> ready);

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  // --- the hub's thread ---
  const WatchRequest& request() const { return request_; }
  bool finished() const { return finished_; }
  bool writing() const { return writing_; }
  bool gone() const { return gone_; }  // the client left
  void Write(Message message);
  // Once; not while writing.
  void End(const absl::Status& status);

  // What is being told, part by part: own messages, or those shared with others.
  std::optional<WatchMessages> telling;
  std::vector<Message> shared;
  size_t next_shared = 0;
  uint64_t telling_revision = 0;

  uint64_t map_watch = 0;             // 0: not bound to a map
  std::optional<uint64_t> revision;   // told completely; absent: needs a checkpoint
  Clock::time_point next_delta_at{};  // by max_rate_hz
  Clock::time_point waiting_since{};  // for the map's next epoch
  Clock::time_point wake_at{};

 private:
  WatchStream(ServiceContext* service, WatchRequest request,
              std::function<void(std::shared_ptr<WatchStream>)> ready)
      : service_(service), request_(std::move(request)), ready_(std::move(ready)) {}

  ServiceContext* const service_;
  const WatchRequest request_;
  const std::function<void(std::shared_ptr<WatchStream>)> ready_;
  const Clock::time_point started_at_ = Clock::now();
  std::shared_ptr<WatchStream> self_;
  Message message_;  // read by the transport while writing
  bool finished_ = false;
  std::atomic<bool> writing_ = false;
  std::atomic<bool> gone_ = false;
};

}  // namespace clearance
