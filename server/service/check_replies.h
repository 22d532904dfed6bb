// Answers about robots, computed from one view.
#pragma once

#include <functional>

#include "absl/status/statusor.h"
#include "clearance/v1/query.pb.h"
#include "proto/wire/check.h"
#include "server/map/map_view.h"

namespace clearance {

// `cancelled` is asked now and then; once it is true the answer is CANCELLED.
absl::StatusOr<v1::CheckTrajectoriesResponse> AnswerTrajectories(
    const MapView& view, const wire::TrajectoriesQuery& query,
    const std::function<bool()>& cancelled);
absl::StatusOr<v1::CheckSpheresResponse> AnswerSpheres(const MapView& view,
                                                       const wire::SpheresQuery& query,
                                                       const std::function<bool()>& cancelled);

}  // namespace clearance
