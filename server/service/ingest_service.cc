#include "server/service/ingest_service.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/frame.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"
#include "server/service/frame_codec.h"
#include "server/service/ingest_stream.h"
#include "server/service/unary_call.h"

namespace clearance {
namespace {

using Call = UnaryCall<v1::IngestFrameResponse>;

absl::Status Submit(ServiceContext* service, const v1::IngestFrameRequest& request,
                    const std::shared_ptr<Call>& call) {
  if (service->draining) return DrainingError();
  const absl::StatusOr<std::string> source = wire::NameFromProto(request.source_id(), "source_id");
  if (!source.ok()) return source.status();
  const absl::StatusOr<double> max_range_m =
      wire::MaxRangeFromProto(request.max_range_m(), "max_range_m");
  if (!max_range_m.ok()) return max_range_m.status();
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service->registry->Get(request.map());
  if (!engine.ok()) return engine.status();

  const auto on_ack = [call](const FrameAck& ack) {
    if (ack.status == FrameAck::Status::kAbandoned) return call->Finish(DrainingError());
    if (!ack.settles()) return;
    v1::IngestFrameResponse response;
    ToProto(ack, response.mutable_ack());
    call->Finish(std::move(response));
  };
  absl::StatusOr<Frame> frame = DecodeFrame(*service, request.frame(), *source, *max_range_m);
  std::string encoded;
  if (frame.ok() && (*engine)->folder()) {
    encoded = EncodeFrameForLog(request.frame(), *source, *max_range_m);
  }
  const Admission admission =
      frame.ok() ? (*engine)->Submit(*std::move(frame), on_ack, &encoded)
                 : (*engine)->SubmitRejected(*source, request.frame().frame_id(),
                                             wire::ViolationsOf(frame.status()), on_ack);
  switch (admission) {
    case Admission::kTaken:
      return absl::OkStatus();
    case Admission::kStopped:
      return DrainingError();
    case Admission::kOverMemory:
      return OverMemoryError(**engine);
    case Admission::kFull:
      break;
  }
  return wire::WithRetry(absl::ResourceExhaustedError(absl::StrFormat(
                             "the queue of map '%s' is full (%d frames); send the frame again",
                             (*engine)->id(), (*engine)->Stats().queue_capacity)),
                         absl::Milliseconds(100));
}

}  // namespace

grpc::ServerBidiReactor<v1::IngestFramesRequest, v1::IngestFramesResponse>*
IngestServiceImpl::IngestFrames(grpc::CallbackServerContext* context) {
  return IngestStream::Start(service_, context, sessions_);
}

grpc::ServerUnaryReactor* IngestServiceImpl::IngestFrame(grpc::CallbackServerContext*,
                                                         const v1::IngestFrameRequest* request,
                                                         v1::IngestFrameResponse* response) {
  auto call = Call::Start(service_, "IngestFrame", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  if (absl::Status s = Submit(service_, *request, call); !s.ok()) call->Finish(std::move(s));
  return reactor;
}

}  // namespace clearance
