// QueryService: convert, call, convert.
#pragma once

#include "clearance/v1/query.grpc.pb.h"
#include "server/service/service_context.h"

namespace clearance {

class QueryServiceImpl final : public v1::QueryService::CallbackService {
 public:
  explicit QueryServiceImpl(ServiceContext* service) : service_(service) {}

  grpc::ServerUnaryReactor* QueryPoints(grpc::CallbackServerContext* context,
                                        const v1::QueryPointsRequest* request,
                                        v1::QueryPointsResponse* response) override;
  grpc::ServerUnaryReactor* ListObjects(grpc::CallbackServerContext* context,
                                        const v1::ListObjectsRequest* request,
                                        v1::ListObjectsResponse* response) override;
  grpc::ServerUnaryReactor* GetSlice(grpc::CallbackServerContext* context,
                                     const v1::GetSliceRequest* request,
                                     v1::GetSliceResponse* response) override;
  grpc::ServerUnaryReactor* CheckTrajectories(grpc::CallbackServerContext* context,
                                              const v1::CheckTrajectoriesRequest* request,
                                              v1::CheckTrajectoriesResponse* response) override;
  grpc::ServerUnaryReactor* CheckSpheres(grpc::CallbackServerContext* context,
                                         const v1::CheckSpheresRequest* request,
                                         v1::CheckSpheresResponse* response) override;
  grpc::ServerUnaryReactor* PinRevision(grpc::CallbackServerContext* context,
                                        const v1::PinRevisionRequest* request,
                                        v1::PinRevisionResponse* response) override;
  grpc::ServerUnaryReactor* ReleasePin(grpc::CallbackServerContext* context,
                                       const v1::ReleasePinRequest* request,
                                       v1::ReleasePinResponse* response) override;
  grpc::ServerWriteReactor<v1::GetRegionResponse>* GetRegion(
      grpc::CallbackServerContext* context, const v1::GetRegionRequest* request) override;
  grpc::ServerBidiReactor<v1::QueryStreamRequest, v1::QueryStreamResponse>* QueryStream(
      grpc::CallbackServerContext* context) override;

 private:
  ServiceContext* const service_;
};

}  // namespace clearance
