// One request of the query service: decode, find the view, compute, answer. The same for calls of
// their own and for those in a QueryStream.
#pragma once

#include <memory>

#include "clearance/v1/query.pb.h"
#include "proto/wire/check.h"
#include "server/service/reply.h"
#include "server/service/service_context.h"

namespace clearance {

wire::CheckLimits WireLimits(const ServiceLimits& limits);

// Reads the request before returning; the reply is finished now or later.
void Start(ServiceContext* service, const v1::QueryPointsRequest& request,
           std::shared_ptr<Reply<v1::QueryPointsResponse>> reply);
void Start(ServiceContext* service, const v1::CheckTrajectoriesRequest& request,
           std::shared_ptr<Reply<v1::CheckTrajectoriesResponse>> reply);
void Start(ServiceContext* service, const v1::CheckSpheresRequest& request,
           std::shared_ptr<Reply<v1::CheckSpheresResponse>> reply);
void Start(ServiceContext* service, const v1::ListObjectsRequest& request,
           std::shared_ptr<Reply<v1::ListObjectsResponse>> reply);
void Start(ServiceContext* service, const v1::GetSliceRequest& request,
           std::shared_ptr<Reply<v1::GetSliceResponse>> reply);
void Start(ServiceContext* service, const v1::PinRevisionRequest& request,
           std::shared_ptr<Reply<v1::PinRevisionResponse>> reply);
void Start(ServiceContext* service, const v1::ReleasePinRequest& request,
           std::shared_ptr<Reply<v1::ReleasePinResponse>> reply);

}  // namespace clearance
