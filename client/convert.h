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
absl::StatusOr<TrajectoryAnswers> FromProto(const v1::CheckTrajectoriesResponse& reply, size_t n);
absl::StatusOr<SphereAnswers> FromProto(const v1::CheckSpheresResponse& reply, size_t n);
absl::StatusOr<RegionBlock> FromProto(const v1::GetRegionResponse& reply,
                                      const RegionOptions& options);

void ToProto(const QueryOptions& options, v1::QueryPointsRequest* request);
void ToProto(const QueryOptions& options, v1::ListObjectsRequest* request);
void ToProto(const SliceOptions& options, v1::GetSliceRequest* request);
void ToProto(const RegionOptions& options, v1::GetRegionRequest* request);
void ToProto(const CheckOptions& options, const std::vector<Sphere>& spheres,
             v1::CheckTrajectoriesRequest* request);
void ToProto(const CheckOptions& options, const std::vector<Sphere>& spheres,
             v1::CheckSpheresRequest* request);
void ToProto(const Trajectory& trajectory, v1::Trajectory* out);

// What the options of queries and checks share by name.
template <typename Options>
void SetLayers(const Options& options, v1::LayerSelection* layers) {
  layers->set_static_only(options.static_only);
  layers->mutable_only_objects()->Add(options.only_objects.begin(), options.only_objects.end());
  layers->mutable_without_objects()->Add(options.without_objects.begin(),
                                         options.without_objects.end());
}

template <typename Options, typename Request>
void SetConsistency(const Options& options, Request* request) {
  if (options.min_revision == 0 && options.epoch == 0 && options.pin_id == 0 &&
      options.wait_s == 0) {
    return;
  }
  v1::Consistency* consistency = request->mutable_consistency();
  consistency->set_min_revision(options.min_revision);
  consistency->set_epoch(options.epoch);
  consistency->set_pin_id(options.pin_id);
  consistency->set_wait_s(options.wait_s);
}

}  // namespace clearance::client
