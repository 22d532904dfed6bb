// Answers of the query RPCs, computed from one view.
#pragma once

#include "absl/status/statusor.h"
#include "clearance/v1/query.pb.h"
#include "proto/wire/query.h"
#include "server/map/map_view.h"

namespace clearance {

// An object at `horizon_s` after the view's stamp.
void ToProto(const ObjectView& object, double horizon_s, v1::ObjectBrief* out);
void ToProto(const ObjectView& object, double horizon_s, v1::ObjectInfo* out);

absl::StatusOr<v1::QueryPointsResponse> AnswerPoints(const MapView& view,
                                                     const wire::PointsQuery& query);

// Recorded poses are cut, oldest first, where the reply would outgrow the message limit.
absl::StatusOr<v1::ListObjectsResponse> AnswerObjects(const MapView& view,
                                                      const wire::ObjectsQuery& query);

absl::StatusOr<v1::GetSliceResponse> AnswerSlice(const MapView& view, const wire::SliceQuery& query,
                                                 uint64_t max_cells);

}  // namespace clearance
