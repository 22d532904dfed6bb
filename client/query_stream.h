// Queries in a pipeline: many are under way at once over one stream.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/types.h"

namespace clearance::client {

// Each call returns once the request is on its way, which waits only where the server has not read
// those before (it reads while fewer than 32 wait). Its callback runs exactly once, on the
// stream's own thread, with the answer or the error; answers may overtake one another. Callbacks
// must not call the stream's methods that wait (Finish) and should be short: while one runs no
// other answer is read. Safe to use from several threads at once.
class QueryStream {
 public:
  virtual ~QueryStream() = default;  // cancels what is under way: callbacks get CANCELLED

  virtual void QueryPoints(const Eigen::Matrix3Xd& points_W, const QueryOptions& options,
                           std::function<void(absl::StatusOr<DistanceAnswers>)> done) = 0;
  virtual void CheckTrajectories(const std::vector<Sphere>& spheres,
                                 const std::vector<Trajectory>& trajectories,
                                 const CheckOptions& options,
                                 std::function<void(absl::StatusOr<TrajectoryAnswers>)> done) = 0;
  virtual void CheckSpheres(const std::vector<Sphere>& spheres, const std::vector<Pose>& T_W_R,
                            const std::vector<double>& times_s, const CheckOptions& options,
                            std::function<void(absl::StatusOr<SphereAnswers>)> done) = 0;

  // Sends no more, waits for all answers and returns how the stream ended. Idempotent.
  virtual absl::Status Finish() = 0;
};

}  // namespace clearance::client
