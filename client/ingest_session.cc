#include "client/ingest_session.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/channel.h"

namespace clearance::client {

absl::StatusOr<std::unique_ptr<IngestSession>> IngestSession::Open(v1::IngestService::Stub& stub,
                                                                   const v1::OpenIngest& open,
                                                                   const std::string& address,
                                                                   absl::Duration stall_timeout,
                                                                   OnAck on_ack) {
  std::unique_ptr<IngestSession> session(
      new IngestSession(address, stall_timeout, std::move(on_ack)));
  session->stream_ = stub.IngestFrames(&session->context_);
  v1::IngestFramesRequest request;
  *request.mutable_open() = open;
  // A failed write tells no more than the status of Finish, which comes below.
  session->stream_->Write(request);
  bool opened = false;
  session->reader_ = std::thread([s = session.get()] { s->Read(); });
  {
    IngestSession* s = session.get();
    absl::Status status = session->Await([s, &opened] {
      opened = s->messages_ > 0;
      return opened;
    });
    if (!status.ok()) return status;
  }
  return session;
}

IngestSession::~IngestSession() {
  if (!finished_) context_.TryCancel();
  if (reader_.joinable()) reader_.join();
  if (!finished_ && stream_ != nullptr) stream_->Finish();
}

void IngestSession::Read() {
  for (v1::IngestFramesResponse response; stream_->Read(&response);) {
    if (response.has_ack()) on_ack_(response.ack());
    absl::MutexLock lock(&mutex_);
    if (response.has_opened()) {
      if (response.opened().has_last_frame_id()) {
        opened_last_frame_id_ = response.opened().last_frame_id();
      }
      credits_ += response.opened().credits().frames();
    }
    if (response.has_credit()) credits_ += response.credit().frames();
    if (response.has_closing()) closing_ = response.closing();
    ++messages_;
    changed_.SignalAll();
  }
  absl::MutexLock lock(&mutex_);
  ended_ = true;
  changed_.SignalAll();
}

absl::Status IngestSession::Await(const std::function<bool()>& condition) {
  bool stalled = false;
  {
    absl::MutexLock lock(&mutex_);
    uint64_t seen = messages_;
    absl::Time give_up = absl::Now() + stall_timeout_;
    while (!condition() && !ended_ && !stalled) {
      const bool timed_out = changed_.WaitWithDeadline(&mutex_, give_up);
      if (messages_ != seen) {
        seen = messages_;
        give_up = absl::Now() + stall_timeout_;
      } else {
        stalled = timed_out && !ended_;
      }
    }
    if (condition()) return absl::OkStatus();
  }
  if (stalled) {
    return absl::DeadlineExceededError(
        absl::StrFormat("the server at %s said nothing for %s while frames were on their way",
                        address_, absl::FormatDuration(stall_timeout_)));
  }
  return Ended();
}

absl::Status IngestSession::Ended() {
  if (!finished_) {
    if (reader_.joinable()) reader_.join();
    final_status_ = CallStatus(stream_->Finish(), address_);
    finished_ = true;
  }
  absl::MutexLock lock(&mutex_);
  if (closing_) {
    if (closing_->reason() == v1::INGEST_CLOSING_REASON_DELETED) {
      return absl::NotFoundError(absl::StrCat("the map was deleted: ", closing_->detail()));
    }
    return absl::UnavailableError(
        absl::StrCat("the server closed the stream: ", closing_->detail()));
  }
  if (final_status_.ok()) return absl::UnavailableError("the server ended the stream");
  return final_status_;
}

absl::Status IngestSession::Write(const v1::IngestFramesRequest& request) {
  absl::Status status = Await([this] { return credits_ > 0; });
  if (!status.ok()) return status;
  {
    absl::MutexLock lock(&mutex_);
    --credits_;
  }
  if (stream_->Write(request)) return absl::OkStatus();
  return Ended();
}

absl::Status IngestSession::AwaitAcks(const std::function<bool()>& done) { return Await(done); }

absl::Status IngestSession::Finish() {
  stream_->WritesDone();
  if (reader_.joinable()) reader_.join();
  if (!finished_) {
    final_status_ = CallStatus(stream_->Finish(), address_);
    finished_ = true;
  }
  return final_status_;
}

}  // namespace clearance::client
