#include "server/service/query_service.h"

#include <memory>
#include <utility>

#include "server/service/query_replies.h"
#include "server/service/resolve.h"
#include "server/service/unary_call.h"
#include "server/service/unimplemented.h"

namespace clearance {
namespace {

constexpr size_t kWorkerCost = kInlineCost + 1;

wire::QueryLimits LimitsOf(const ServiceContext& service) {
  wire::QueryLimits limits;
  limits.max_points = service.limits.max_query_points;
  limits.max_wait_s = service.limits.max_wait_s;
  return limits;
}

}  // namespace

grpc::ServerUnaryReactor* QueryServiceImpl::QueryPoints(grpc::CallbackServerContext*,
                                                        const v1::QueryPointsRequest* request,
                                                        v1::QueryPointsResponse* response) {
  auto call = UnaryCall<v1::QueryPointsResponse>::Start(service_, "QueryPoints", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  absl::StatusOr<wire::PointsQuery> decoded =
      wire::PointsQueryFromProto(*request, LimitsOf(*service_));
  if (!decoded.ok()) {
    call->Finish(decoded.status());
    return reactor;
  }
  auto query = std::make_shared<const wire::PointsQuery>(*std::move(decoded));
  // Searching for unknown space costs far more than a look-up.
  const size_t cost = query->points_W.cols() * (query->unknown_distances ? 16 : 1);
  Answer<v1::QueryPointsResponse>(
      service_, query->settings.map, query->settings.consistency, cost, std::move(call),
      [query](const ViewPtr& view) { return AnswerPoints(*view, *query); });
  return reactor;
}

grpc::ServerUnaryReactor* QueryServiceImpl::ListObjects(grpc::CallbackServerContext*,
                                                        const v1::ListObjectsRequest* request,
                                                        v1::ListObjectsResponse* response) {
  auto call = UnaryCall<v1::ListObjectsResponse>::Start(service_, "ListObjects", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::StatusOr<wire::ObjectsQuery> query =
      wire::ObjectsQueryFromProto(*request, LimitsOf(*service_));
  if (!query.ok()) {
    call->Finish(query.status());
    return reactor;
  }
  Answer<v1::ListObjectsResponse>(
      service_, query->settings.map, query->settings.consistency,
      query->include_history ? kWorkerCost : 0, std::move(call),
      [query = *query](const ViewPtr& view) { return AnswerObjects(*view, query); });
  return reactor;
}

grpc::ServerUnaryReactor* QueryServiceImpl::GetSlice(grpc::CallbackServerContext*,
                                                     const v1::GetSliceRequest* request,
                                                     v1::GetSliceResponse* response) {
  auto call = UnaryCall<v1::GetSliceResponse>::Start(service_, "GetSlice", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::StatusOr<wire::SliceQuery> query =
      wire::SliceQueryFromProto(*request, LimitsOf(*service_));
  if (!query.ok()) {
    call->Finish(query.status());
    return reactor;
  }
  Answer<v1::GetSliceResponse>(
      service_, query->settings.map, query->settings.consistency, kWorkerCost, std::move(call),
      [query = *query, cells = service_->limits.max_slice_cells](const ViewPtr& view) {
        return AnswerSlice(*view, query, cells);
      });
  return reactor;
}

grpc::ServerUnaryReactor* QueryServiceImpl::CheckTrajectories(grpc::CallbackServerContext* context,
                                                              const v1::CheckTrajectoriesRequest*,
                                                              v1::CheckTrajectoriesResponse*) {
  return UnaryNotOffered(context, "CheckTrajectories");
}

grpc::ServerUnaryReactor* QueryServiceImpl::CheckSpheres(grpc::CallbackServerContext* context,
                                                         const v1::CheckSpheresRequest*,
                                                         v1::CheckSpheresResponse*) {
  return UnaryNotOffered(context, "CheckSpheres");
}

grpc::ServerUnaryReactor* QueryServiceImpl::PinRevision(grpc::CallbackServerContext* context,
                                                        const v1::PinRevisionRequest*,
                                                        v1::PinRevisionResponse*) {
  return UnaryNotOffered(context, "PinRevision");
}

grpc::ServerUnaryReactor* QueryServiceImpl::ReleasePin(grpc::CallbackServerContext* context,
                                                       const v1::ReleasePinRequest*,
                                                       v1::ReleasePinResponse*) {
  return UnaryNotOffered(context, "ReleasePin");
}

grpc::ServerWriteReactor<v1::GetRegionResponse>* QueryServiceImpl::GetRegion(
    grpc::CallbackServerContext*, const v1::GetRegionRequest*) {
  return WritesNotOffered<v1::GetRegionResponse>("GetRegion");
}

grpc::ServerBidiReactor<v1::QueryStreamRequest, v1::QueryStreamResponse>*
QueryServiceImpl::QueryStream(grpc::CallbackServerContext*) {
  return StreamNotOffered<v1::QueryStreamRequest, v1::QueryStreamResponse>("QueryStream");
}

}  // namespace clearance
