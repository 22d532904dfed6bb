// IngestService: the stream and its unary twin.
#pragma once

#include "clearance/v1/ingest.grpc.pb.h"
#include "server/service/ingest_sessions.h"
#include "server/service/service_context.h"

namespace clearance {

class IngestServiceImpl final : public v1::IngestService::CallbackService {
 public:
  IngestServiceImpl(ServiceContext* service, IngestSessions* sessions)
      : service_(service), sessions_(sessions) {}

  grpc::ServerBidiReactor<v1::IngestFramesRequest, v1::IngestFramesResponse>* IngestFrames(
      grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* IngestFrame(grpc::CallbackServerContext* context,
                                        const v1::IngestFrameRequest* request,
                                        v1::IngestFrameResponse* response) override;

 private:
  ServiceContext* const service_;
  IngestSessions* const sessions_;
};

}  // namespace clearance
