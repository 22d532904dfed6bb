// Checks of robots on a view in this process, as the server answers them. Private to the mirror.
#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "client/types.h"
#include "server/map/map_view.h"

namespace clearance::client {

absl::StatusOr<TrajectoryAnswers> AnswerTrajectories(const MapView& view,
                                                     const std::vector<Sphere>& spheres,
                                                     const std::vector<Trajectory>& trajectories,
                                                     const CheckOptions& options);

absl::StatusOr<SphereAnswers> AnswerSpheres(const MapView& view, const std::vector<Sphere>& spheres,
                                            const std::vector<Pose>& T_W_R,
                                            const std::vector<double>& times_s,
                                            const CheckOptions& options);

}  // namespace clearance::client
