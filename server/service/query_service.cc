#include "server/service/query_service.h"

#include "server/service/query_calls.h"
#include "server/service/query_stream.h"
#include "server/service/region_stream.h"
#include "server/service/unary_call.h"

namespace clearance {
namespace {

template <typename Request, typename Response>
grpc::ServerUnaryReactor* Run(ServiceContext* service, const char* method, const Request& request,
                              Response* response) {
  auto call = UnaryCall<Response>::Start(service, method, response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  Start(service, request, std::move(call));
  return reactor;
}

}  // namespace

grpc::ServerUnaryReactor* QueryServiceImpl::QueryPoints(grpc::CallbackServerContext*,
                                                        const v1::QueryPointsRequest* request,
                                                        v1::QueryPointsResponse* response) {
  return Run(service_, "QueryPoints", *request, response);
}

grpc::ServerUnaryReactor* QueryServiceImpl::CheckTrajectories(
    grpc::CallbackServerContext*, const v1::CheckTrajectoriesRequest* request,
    v1::CheckTrajectoriesResponse* response) {
  return Run(service_, "CheckTrajectories", *request, response);
}

grpc::ServerUnaryReactor* QueryServiceImpl::CheckSpheres(grpc::CallbackServerContext*,
                                                         const v1::CheckSpheresRequest* request,
                                                         v1::CheckSpheresResponse* response) {
  return Run(service_, "CheckSpheres", *request, response);
}

grpc::ServerUnaryReactor* QueryServiceImpl::ListObjects(grpc::CallbackServerContext*,
                                                        const v1::ListObjectsRequest* request,
                                                        v1::ListObjectsResponse* response) {
  return Run(service_, "ListObjects", *request, response);
}

grpc::ServerUnaryReactor* QueryServiceImpl::GetSlice(grpc::CallbackServerContext*,
                                                     const v1::GetSliceRequest* request,
                                                     v1::GetSliceResponse* response) {
  return Run(service_, "GetSlice", *request, response);
}

grpc::ServerUnaryReactor* QueryServiceImpl::PinRevision(grpc::CallbackServerContext*,
                                                        const v1::PinRevisionRequest* request,
                                                        v1::PinRevisionResponse* response) {
  return Run(service_, "PinRevision", *request, response);
}

grpc::ServerUnaryReactor* QueryServiceImpl::ReleasePin(grpc::CallbackServerContext*,
                                                       const v1::ReleasePinRequest* request,
                                                       v1::ReleasePinResponse* response) {
  return Run(service_, "ReleasePin", *request, response);
}

grpc::ServerWriteReactor<v1::GetRegionResponse>* QueryServiceImpl::GetRegion(
    grpc::CallbackServerContext*, const v1::GetRegionRequest* request) {
  return RegionStream::Start(service_, *request);
}

grpc::ServerBidiReactor<v1::QueryStreamRequest, v1::QueryStreamResponse>*
QueryServiceImpl::QueryStream(grpc::CallbackServerContext* context) {
  return QueryStreamCall::Start(service_, context);
}

}  // namespace clearance
