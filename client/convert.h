// Generated messages -> the SDK's structs, and requests from options. Private to the SDK.
#pragma once

#include "absl/status/statusor.h"
#include "clearance/v1/admin.pb.h"
#include "clearance/v1/ingest.pb.h"
#include "clearance/v1/map.pb.h"
#include "clearance/v1/query.pb.h"
#include "client/ingest_stream.h"
#include "client/types.h"

namespace clearance::client {

MapStamp FromProto(const v1::MapStamp& stamp);
ObjectBrief FromProto(const v1::ObjectBrief& brief);
FrameAck FromProto(const v1::FrameAck& ack);

// DATA_LOSS where the reply's arrays do not have the promised lengths.
absl::StatusOr<DistanceAnswers> FromProto(const v1::QueryPointsResponse& reply, size_t n,
                                          const QueryOptions& options);
absl::StatusOr<ObjectInfo> FromProto(const v1::ObjectInfo& info);
absl::StatusOr<Slice> FromProto(const v1::GetSliceResponse& reply);
absl::StatusOr<MapInfo> FromProto(const v1::MapInfo& info);
ServerStats FromProto(const v1::GetStatsResponse& reply);

void ToProto(const QueryOptions& options, v1::QueryPointsRequest* request);
void ToProto(const QueryOptions& options, v1::ListObjectsRequest* request);
void ToProto(const SliceOptions& options, v1::GetSliceRequest* request);

}  // namespace clearance::client
