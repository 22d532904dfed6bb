#include "server/service/ingest_stream.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/frame.h"
#include "proto/wire/grpc_status.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"
#include "server/service/frame_codec.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

constexpr double kResumeAfterS = 1.0;

v1::IngestStatus StatusOf(FrameAck::Status status) {
  switch (status) {
    case FrameAck::Status::kAccepted:
      return v1::INGEST_STATUS_ACCEPTED;
    case FrameAck::Status::kIntegrated:
      return v1::INGEST_STATUS_INTEGRATED;
    case FrameAck::Status::kDuplicate:
      return v1::INGEST_STATUS_DUPLICATE;
    case FrameAck::Status::kDropped:
      return v1::INGEST_STATUS_DROPPED;
    case FrameAck::Status::kRejected:
      return v1::INGEST_STATUS_REJECTED;
    case FrameAck::Status::kAbandoned:
      break;
  }
  return v1::INGEST_STATUS_UNSPECIFIED;
}

}  // namespace

void ToProto(const FrameAck& ack, v1::FrameAck* out) {
  out->set_frame_id(ack.frame_id);
  out->set_status(StatusOf(ack.status));
  ToProto(ack.stamp, out->mutable_stamp());
  for (const Violation& violation : ack.violations) {
    wire::ToProto(violation, out->add_violations());
  }
  out->set_queue_ms(ack.queue_ms);
  out->set_integrate_ms(ack.integrate_ms);
}

absl::StatusOr<Frame> DecodeFrame(const ServiceContext& service, const v1::Frame& frame,
                                  const std::string& source, double max_range_m) {
  FrameLimits limits;
  limits.max_points =
      frame.has_depth() ? service.limits.max_image_pixels : service.limits.max_frame_points;
  limits.max_motions = service.limits.max_motions;
  absl::StatusOr<Frame> decoded = wire::FrameFromProto(frame, limits);
  if (!decoded.ok()) return decoded.status();
  decoded->source_id = source;
  decoded->max_range_m = max_range_m;
  return decoded;
}

absl::Status OverMemoryError(const MappingEngine& engine) {
  return wire::WithRetry(
      absl::ResourceExhaustedError(absl::StrFormat(
          "%s: no more frames are taken. Clear a region, delete a map or raise the limit",
          engine.Stats().over_memory)),
      absl::Seconds(5));
}

IngestStream* IngestStream::Start(ServiceContext* service, const grpc::ServerContextBase* context,
                                  IngestSessions* sessions) {
  std::shared_ptr<IngestStream> stream(new IngestStream(service, context, sessions));
  stream->self_ = stream;
  ++service->open_streams;
  stream->Drive();
  return stream.get();
}

void IngestStream::OnDone() {
  Leave();
  --service_->open_streams;
  self_.reset();
}

void IngestStream::Leave() {
  MapRegistry::EnginePtr engine;
  {
    MutexLock lock(&mu_);
    engine = engine_;
  }
  if (engine) sessions_->Remove(engine->id(), source_, this);
}

void IngestStream::Close(v1::IngestClosingReason reason) {
  {
    MutexLock lock(&mu_);
    if (opened_ && !closing_ && !end_) {
      closing_ = reason;
      if (reason == v1::INGEST_CLOSING_REASON_DELETED) {
        EndWith(absl::NotFoundError(absl::StrFormat("map '%s' was deleted", engine_->id())));
      } else if (reason == v1::INGEST_CLOSING_REASON_RESTORED) {
        EndWith(wire::WithRetry(
            absl::UnavailableError(absl::StrFormat(
                "a snapshot of map '%s' is being restored; open again", engine_->id())),
            absl::Seconds(1)));
      } else {
        EndWith(DrainingError());
      }
    }
  }
  Drive();
}

void IngestStream::EndWith(absl::Status status) {
  if (!end_) end_ = std::move(status);
  want_read_ = false;
}

IngestStream::Step IngestStream::NextStep() {
  if (finished_) return Step::kNone;
  if (want_read_) return Step::kRead;
  if (writing_) return Step::kNone;
  if (broken_) return Step::kFinish;
  if (!out_.empty()) return Step::kWrite;
  if (!end_ || in_flight_ > 0) return Step::kNone;
  if (!closing_) return Step::kFinish;
  // All acks are out: say where to resume, once.
  v1::IngestClosing* closing = out_.emplace_back().mutable_closing();
  closing->set_reason(*closing_);
  closing->set_resume_after_s(kResumeAfterS);
  closing->set_detail(std::string(end_->message()));
  if (const auto last = engine_->LastSettledId(source_)) closing->set_last_frame_id(*last);
  closing_.reset();
  return Step::kWrite;
}

void IngestStream::Drive() {
  const std::shared_ptr<IngestStream> keep = shared_from_this();
  mu_.Lock();
  again_ = true;
  if (driving_) {
    mu_.Unlock();
    return;
  }
  driving_ = true;
  while (again_) {
    again_ = false;
    switch (NextStep()) {
      case Step::kNone:
        break;
      case Step::kRead:
        want_read_ = false;
        again_ = true;
        mu_.Unlock();
        StartRead(&request_);
        mu_.Lock();
        break;
      case Step::kWrite:
        writing_ = true;
        response_ = std::move(out_.front());
        out_.pop_front();
        // Credits count from when they are sent: a client that reads nothing gets none.
        if (response_.has_credit()) credits_ += response_.credit().frames();
        again_ = true;
        mu_.Unlock();
        StartWrite(&response_);
        mu_.Lock();
        break;
      case Step::kFinish: {
        finished_ = true;
        const absl::Status status =
            broken_ ? absl::CancelledError("the client is gone") : *std::move(end_);
        mu_.Unlock();
        Leave();
        Finish(wire::ToGrpcStatus(status));
        mu_.Lock();
        break;
      }
    }
  }
  driving_ = false;
  mu_.Unlock();
}

void IngestStream::OnCancel() {
  Leave();  // at once: the client may already be back
  {
    MutexLock lock(&mu_);
    broken_ = true;
    want_read_ = false;
  }
  Drive();
}

void IngestStream::OnWriteDone(bool ok) {
  {
    MutexLock lock(&mu_);
    writing_ = false;
    if (!ok) {
      broken_ = true;
      want_read_ = false;
    }
  }
  Drive();
}

void IngestStream::OnReadDone(bool ok) {
  bool opened;
  {
    MutexLock lock(&mu_);
    opened = opened_;
    if (!ok) EndWith(absl::OkStatus());
    if (end_ || broken_) ok = false;  // a frame that came too late is not settled
  }
  if (!ok) return Drive();
  if (!opened) {
    absl::Status status = OpenFrom(request_);
    if (!status.ok()) {
      MutexLock lock(&mu_);
      EndWith(std::move(status));
    }
    return Drive();
  }
  if (request_.message_case() != v1::IngestFramesRequest::kFrame) {
    MutexLock lock(&mu_);
    EndWith(wire::InvalidField("message", -1, request_.has_open() ? "a second open" : "nothing",
                               "frame"));
  } else {
    TakeFrame(request_.frame());
  }
  Drive();
}

absl::Status IngestStream::OpenFrom(const v1::IngestFramesRequest& request) {
  if (service_->draining) return DrainingError();
  if (!request.has_open()) {
    return wire::InvalidField("message", -1, request.has_frame() ? "frame" : "nothing",
                              "open as the first message");
  }
  const v1::OpenIngest& open = request.open();
  if (absl::Status s = service_->access->Check(*context_, Right::kIngest, OnMap(open.map()));
      !s.ok()) {
    return s;
  }
  const absl::StatusOr<std::string> source =
      wire::NameFromProto(open.source_id(), "open.source_id");
  if (!source.ok()) return source.status();
  const absl::StatusOr<double> max_range_m =
      wire::MaxRangeFromProto(open.max_range_m(), "open.max_range_m");
  if (!max_range_m.ok()) return max_range_m.status();
  absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Get(open.map());
  if (!engine.ok()) return engine.status();
  if (!sessions_->Open((*engine)->id(), *source, shared_from_this())) {
    return wire::WithRetry(
        absl::FailedPreconditionError(absl::StrFormat(
            "open.source_id: another stream of source '%s' into map '%s' is open; close it, or "
            "send under another source_id",
            *source, (*engine)->id())),
        absl::Seconds(1));
  }
  const bool live = (*engine)->config().overload == OverloadPolicy::kDropOldestStatic;
  const uint64_t credits = live ? service_->limits.live_credits : service_->limits.credits;
  v1::IngestFramesResponse response;
  v1::IngestOpened* opened = response.mutable_opened();
  if (const auto last = (*engine)->LastSettledId(*source)) opened->set_last_frame_id(*last);
  opened->mutable_credits()->set_frames(credits);
  opened->mutable_limits()->set_max_points(service_->limits.max_frame_points);
  opened->mutable_limits()->set_max_frame_bytes(service_->limits.max_message_bytes);
  opened->mutable_limits()->set_max_motions(service_->limits.max_motions);
  ToProto(StampOf(*(*engine)->Latest()), opened->mutable_stamp());
  bool gone;
  {
    MutexLock lock(&mu_);
    engine_ = *std::move(engine);
    source_ = *source;
    max_range_m_ = *max_range_m;
    opened_ = true;
    credits_ = credits;
    want_read_ = !end_ && !broken_;
    out_.push_back(std::move(response));
    gone = broken_;
  }
  // Whatever happened meanwhile has not seen this stream open.
  if (gone) Leave();
  if (service_->draining) Close(v1::INGEST_CLOSING_REASON_DRAINING);
  if (!service_->registry->Get(open.map()).ok()) Close(ReasonOfEnd());
  return absl::OkStatus();
}

v1::IngestClosingReason IngestStream::ReasonOfEnd() const {
  if (service_->draining) return v1::INGEST_CLOSING_REASON_DRAINING;
  const absl::Status found = service_->registry->Get(engine_->id()).status();
  return absl::IsNotFound(found) ? v1::INGEST_CLOSING_REASON_DELETED
                                 : v1::INGEST_CLOSING_REASON_RESTORED;
}

void IngestStream::TakeFrame(const v1::Frame& frame) {
  {
    MutexLock lock(&mu_);
    if (credits_ == 0) {
      return EndWith(absl::ResourceExhaustedError(absl::StrFormat(
          "frame %d was sent without credit: %d frames are in flight. Wait for credit messages",
          frame.frame_id(), in_flight_)));
    }
    --credits_;
    ++in_flight_;
  }
  auto arrival = std::make_shared<Arrival>();
  absl::StatusOr<Frame> decoded = DecodeFrame(*service_, frame, source_, max_range_m_);
  if (decoded.ok()) {
    arrival->frame = *std::move(decoded);
    if (engine_->folder()) arrival->encoded = EncodeFrameForLog(frame, source_, max_range_m_);
  } else {
    arrival->frame.frame_id = frame.frame_id();
    arrival->violations = wire::ViolationsOf(decoded.status());
  }
  Admit(std::move(arrival));
}

void IngestStream::Admit(std::shared_ptr<Arrival> arrival) {
  const auto on_ack = [self = shared_from_this()](const FrameAck& ack) { self->OnAck(ack); };
  const Admission admission =
      arrival->violations.empty()
          ? engine_->Submit(std::move(arrival->frame), on_ack, &arrival->encoded)
          : engine_->SubmitRejected(source_, arrival->frame.frame_id, arrival->violations, on_ack);
  if (admission == Admission::kFull) {
    {
      MutexLock lock(&mu_);
      parked_ = true;
    }
    engine_->NotifyRoom([self = shared_from_this(), arrival] { self->Admit(arrival); });
    return;
  }
  {
    MutexLock lock(&mu_);
    parked_ = false;
    if (admission == Admission::kOverMemory) {
      --in_flight_;  // not settled: the client may send it again later
      EndWith(OverMemoryError(*engine_));
    } else if (admission == Admission::kStopped) {
      --in_flight_;  // not settled: the client sends it again
      if (!closing_ && !end_) {
        closing_ = ReasonOfEnd();
        EndWith(DrainingError());
      }
    } else if (!end_ && !broken_) {
      want_read_ = true;
    }
  }
  Drive();
}

void IngestStream::OnAck(const FrameAck& ack) {
  {
    MutexLock lock(&mu_);
    if (ack.status == FrameAck::Status::kAbandoned) {
      --in_flight_;
    } else {
      ToProto(ack, out_.emplace_back().mutable_ack());
      if (ack.settles()) {
        --in_flight_;
        out_.emplace_back().mutable_credit()->set_frames(1);
      }
    }
    if (broken_) out_.clear();
  }
  Drive();
}

}  // namespace clearance
