// Where planners get distances from: a server, or later a mirror of its map in this process.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "absl/status/statusor.h"
#include "client/types.h"

namespace clearance::client {

class EsdfClient;

// Batched distances. Implementations are safe to call from several threads at once.
class DistanceSource {
 public:
  virtual ~DistanceSource() = default;

  // Distances (m), states, unit gradients in W and nearest objects at `points_W` (3 x n, metres,
  // n >= 1), `horizon_s` after the map's stamp. All from one revision. Errors as of QueryPoints.
  virtual absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                                    double horizon_s) const = 0;
};

// Every call is one round trip to the server. `client` must outlive the source.
std::unique_ptr<DistanceSource> MakeRemoteDistanceSource(const EsdfClient& client,
                                                         QueryOptions options = {});

}  // namespace clearance::client
