// Regions and pins.
#include <grpcpp/client_context.h>

#include <chrono>
#include <utility>

#include "client/channel.h"
#include "client/connection.h"
#include "client/convert.h"
#include "proto/wire/geometry.h"

namespace clearance::client {
namespace {

void SetDeadline(absl::Duration timeout, grpc::ClientContext* context) {
  context->set_deadline(std::chrono::system_clock::now() + absl::ToChronoMicroseconds(timeout));
}

}  // namespace

absl::Status EsdfClient::GetRegion(const RegionOptions& options, const RegionSink& sink) const {
  v1::GetRegionRequest request;
  ToProto(options, &request);
  request.set_map(connection_->MapOr(options.query.map));
  grpc::ClientContext context;
  SetDeadline(connection_->options.export_timeout, &context);
  const auto reader = connection_->query->GetRegion(&context, request);
  absl::Status status;
  for (v1::GetRegionResponse reply; status.ok() && reader->Read(&reply);) {
    absl::StatusOr<RegionBlock> block = FromProto(reply, options);
    status = block.ok() ? sink(*std::move(block)) : block.status();
  }
  if (!status.ok()) context.TryCancel();
  const grpc::Status finished = reader->Finish();
  if (!status.ok()) return status;
  return CallStatus(finished, connection_->options.address);
}

absl::StatusOr<Pin> EsdfClient::PinRevision(const std::string& map, uint64_t revision,
                                            double ttl_s) const {
  v1::PinRevisionRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_revision(revision);
  request.set_ttl_s(ttl_s);
  grpc::ClientContext context;
  SetDeadline(connection_->options.call_timeout, &context);
  v1::PinRevisionResponse reply;
  absl::Status status = CallStatus(connection_->query->PinRevision(&context, request, &reply),
                                   connection_->options.address);
  if (!status.ok()) return status;
  return Pin{reply.pin_id(), FromProto(reply.stamp()), reply.ttl_s()};
}

absl::Status EsdfClient::ReleasePin(const std::string& map, uint64_t pin_id) const {
  v1::ReleasePinRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_pin_id(pin_id);
  grpc::ClientContext context;
  SetDeadline(connection_->options.call_timeout, &context);
  v1::ReleasePinResponse reply;
  return CallStatus(connection_->query->ReleasePin(&context, request, &reply),
                    connection_->options.address);
}

}  // namespace clearance::client
