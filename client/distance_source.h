// Where planners get distances from: a server, or a mirror of its map in this process.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "client/types.h"

namespace clearance::client {

class EsdfClient;

// Batched questions to one map. Every call is answered from one revision, which the answer names.
// Implementations are safe to call from several threads at once. Times are seconds after the map's
// stamp unless the options say otherwise; a time before the stamp or beyond the map's max_horizon_s
// is OUT_OF_RANGE. Other errors as of the RPC of the same name.
class DistanceSource {
 public:
  virtual ~DistanceSource() = default;

  // Distances (m), states, unit gradients in W and nearest objects at `points_W` (3 x n, metres,
  // n >= 1), all at `horizon_s`.
  virtual absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                                    double horizon_s) const = 0;
  // The same, each point at its own horizon (n seconds).
  virtual absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                                    const std::vector<float>& horizons_s) const = 0;

  // Whether a robot made of `spheres` (at least one) can follow each of the trajectories, by
  // conservative advancement: nothing is tunnelled through at any speed.
  virtual absl::StatusOr<TrajectoryAnswers> CheckTrajectories(
      const std::vector<Sphere>& spheres, const std::vector<Trajectory>& trajectories,
      const CheckOptions& options) const = 0;

  // Whether the robot collides at each of `T_W_R` (n >= 1), each at its own time (n seconds, any
  // order; empty: all at the reference time).
  virtual absl::StatusOr<SphereAnswers> CheckSpheres(const std::vector<Sphere>& spheres,
                                                     const std::vector<Pose>& T_W_R,
                                                     const std::vector<double>& times_s,
                                                     const CheckOptions& options) const = 0;

  // What would answer now, and how old it is. A mirror that lost its server still answers: its
  // staleness_s grows.
  virtual absl::StatusOr<MapStamp> Stamp() const = 0;
};

// Every call is one round trip to the server. `client` must outlive the source. Of `options` the
// map, layers, margins and consistency count; those of a check are its own.
std::unique_ptr<DistanceSource> MakeRemoteDistanceSource(const EsdfClient& client,
                                                         QueryOptions options = {});

}  // namespace clearance::client
