// The SDK's answers from a view in this process. Private to the mirror.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "absl/status/statusor.h"
#include "client/types.h"
#include "server/map/map_view.h"

namespace clearance::client {

MapStamp MapStampOf(const MapView& view);

// As the server answers QueryPoints with gradients and objects. `horizons_s`: one a point, in place
// of `horizon_s`; or empty.
absl::StatusOr<DistanceAnswers> AnswerDistances(const MapView& view,
                                                const Eigen::Matrix3Xd& points_W, double horizon_s,
                                                const std::vector<float>& horizons_s);

}  // namespace clearance::client
