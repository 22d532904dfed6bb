#include "client/ingest_stream.h"

#include <algorithm>
#include <deque>
#include <random>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "client/connection.h"
#include "client/convert.h"
#include "client/ingest_session.h"
#include "proto/wire/frame.h"

namespace clearance::client {
namespace {

// Whether opening a new stream may help. A stream of this source that the server has not yet given
// up is FAILED_PRECONDITION for a moment after a cut.
bool MayReconnect(const absl::Status& status, bool reconnecting) {
  switch (status.code()) {
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kCancelled:
    case absl::StatusCode::kInternal:  // a reset in the middle of a message
      return true;
    case absl::StatusCode::kFailedPrecondition:
      return reconnecting;
    default:
      return false;
  }
}

class ResumingIngestStream final : public IngestStream {
 public:
  ResumingIngestStream(std::shared_ptr<grpc::Channel> channel, std::string address,
                       IngestOptions options)
      : stub_(v1::IngestService::NewStub(std::move(channel))),
        address_(std::move(address)),
        options_(std::move(options)),
        jitter_(std::random_device{}()) {
    open_.set_map(options_.map);
    open_.set_source_id(options_.source_id);
    open_.set_max_range_m(options_.max_range_m);
  }

  absl::Status Open() {
    auto session = IngestSession::Open(*stub_, open_, address_, options_.stall_timeout,
                                       [this](const v1::FrameAck& ack) { OnAck(ack); });
    if (!session.ok()) return session.status();
    session_ = *std::move(session);
    absl::MutexLock lock(&mutex_);
    const std::optional<uint64_t> server = session_->opened_last_frame_id();
    if (last_settled_ && (!server || *server < *last_settled_)) {
      const uint64_t had = *std::exchange(last_settled_, server);
      return absl::AbortedError(absl::StrFormat(
          "the server stands before frame %d, which it had settled: its map was restored or made "
          "anew; open again and continue behind last_frame_id",
          had));
    }
    last_settled_ = server;
    // Settled while the connection was gone; their acks are lost.
    if (server) {
      std::erase_if(pending_, [&](const auto& p) { return p->frame().frame_id() <= *server; });
    }
    return absl::OkStatus();
  }

  std::optional<uint64_t> last_frame_id() const override {
    absl::MutexLock lock(&mutex_);
    return last_settled_;
  }

  uint64_t reconnects() const override { return reconnects_; }

  absl::Status Send(const Frame& frame) override {
    auto request = std::make_shared<v1::IngestFramesRequest>();
    wire::ToProto(frame, request->mutable_frame());
    {
      // Kept until settled, so that it can be sent again; its ack may arrive while Write returns.
      absl::MutexLock lock(&mutex_);
      pending_.push_back(request);
    }
    absl::Status status =
        session_ ? session_->Write(*request) : absl::UnavailableError("the stream is not open");
    return status.ok() ? status : Recover(std::move(status));
  }

  absl::Status Finish() override {
    for (;;) {
      absl::Status status = session_ ? session_->AwaitAcks([this] {
        absl::MutexLock lock(&mutex_);
        return pending_.empty();
      })
                                     : absl::UnavailableError("the stream is not open");
      if (status.ok()) break;
      if (status = Recover(std::move(status)); !status.ok()) return status;
    }
    absl::Status status = session_->Finish();
    session_.reset();
    return status;
  }

 private:
  using Requests = std::deque<std::shared_ptr<const v1::IngestFramesRequest>>;

  void OnAck(const v1::FrameAck& ack) {
    if (ack.status() != v1::INGEST_STATUS_ACCEPTED) {
      absl::MutexLock lock(&mutex_);
      last_settled_ = std::max(last_settled_.value_or(0), ack.frame_id());
      // One by one: a malformed frame is settled before those that wait in the queue.
      std::erase_if(pending_,
                    [&](const auto& p) { return p->frame().frame_id() == ack.frame_id(); });
    }
    if (options_.on_ack) options_.on_ack(FromProto(ack));
  }

  // Opens a new stream and sends what is pending again, until it works or the time is up.
  absl::Status Recover(absl::Status status) {
    const absl::Time give_up = absl::Now() + options_.reconnect_for;
    absl::Duration backoff = options_.min_backoff;
    bool reconnecting = false;
    while (MayReconnect(status, reconnecting)) {
      reconnecting = true;
      session_.reset();
      if (absl::Now() + backoff > give_up) {
        return absl::UnavailableError(absl::StrFormat(
            "gave up reconnecting to %s after %s: %s", address_,
            absl::FormatDuration(options_.reconnect_for), std::string(status.message())));
      }
      // Full jitter: many clients of a restarted server do not come back at once.
      absl::SleepFor(backoff * std::uniform_real_distribution<double>(0.5, 1.0)(jitter_));
      backoff = std::min(backoff * 2, options_.max_backoff);
      ++reconnects_;
      status = Open();
      if (status.ok()) status = Resend();
      if (status.ok()) return status;
    }
    return status;
  }

  absl::Status Resend() {
    Requests frames;
    {
      absl::MutexLock lock(&mutex_);
      frames = pending_;
    }
    for (const auto& frame : frames) {
      absl::Status status = session_->Write(*frame);
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }

  const std::unique_ptr<v1::IngestService::Stub> stub_;
  const std::string address_;
  const IngestOptions options_;
  v1::OpenIngest open_;
  std::mt19937 jitter_;
  uint64_t reconnects_ = 0;
  mutable absl::Mutex mutex_;
  std::optional<uint64_t> last_settled_ ABSL_GUARDED_BY(mutex_);
  Requests pending_ ABSL_GUARDED_BY(mutex_);  // sent, not settled, in order
  // Last: its reader thread calls OnAck, so that it must end before the rest does.
  std::unique_ptr<IngestSession> session_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<IngestStream>> EsdfClient::OpenIngest(IngestOptions options) const {
  options.map = connection_->MapOr(options.map);
  auto stream = std::make_unique<ResumingIngestStream>(
      connection_->channel, connection_->options.address, std::move(options));
  if (absl::Status s = stream->Open(); !s.ok()) return s;
  return stream;
}

}  // namespace clearance::client
