// A copy of a server's map in this process, kept up to date: planners ask it without a round trip.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/distance_source.h"
#include "client/esdf_client.h"

namespace clearance {
struct MapView;
}

namespace clearance::client {

// What one message batch brought.
struct MirrorUpdate {
  MapStamp stamp;
  bool checkpoint = false;     // else a delta
  uint64_t prev_revision = 0;  // of a delta
  uint64_t bytes = 0;          // of its messages
  double apply_ms = 0;
};

struct MirrorOptions {
  ClientOptions client;        // address and map
  std::optional<Aabb> bounds;  // W; the field outside reads as unknown
  bool poses_only = false;     // objects' poses without surfaces, no field: for display
  double max_rate_hz = 0;      // updates a second at most; 0 = every revision
  // Answers are flagged stale when the newest frame is older than this; 0 = the server's value.
  double stale_after_s = 0;
  absl::Duration first_backoff = absl::Milliseconds(50);  // between attempts to connect, doubling
  absl::Duration max_backoff = absl::Seconds(2);
  uint64_t memory_limit_bytes = uint64_t{8} << 30;
  // Called on the mirror's thread after each new view; must be short.
  std::function<void(const MirrorUpdate&)> on_update;
};

struct MirrorStatus {
  bool connected = false;  // a watch is running
  bool ready = false;      // there is a view
  MapStamp stamp;          // of the view; staleness_s is its age now
  // Since the newest frame was published, and since anything came from the server. Both grow when
  // the server disappears.
  double age_s = 0, silence_s = 0;
  bool stale = true;        // age_s is beyond the limit, or nothing is there
  absl::Status last_error;  // why the last watch ended; OK while connected
  uint64_t connects = 0, resumes = 0, checkpoints = 0, deltas = 0;
  uint64_t bytes = 0;                          // of all messages
  uint64_t block_bytes = 0, object_bytes = 0;  // of the field, and of poses and surfaces
  uint64_t surface_bytes = 0;                  // of object_bytes
  uint64_t blocks = 0;                         // told, changed or removed
};

// Answers bit for bit as the server does at the same revision: it holds the same blocks, poses and
// surfaces and runs the same code on them. One thread follows the map; it connects again (backoff
// with jitter) and resumes where it was when the connection breaks, and starts over when the map
// begins a new epoch. Meanwhile queries answer from the last view and say so: kFlagStale, and a
// growing staleness_s in the stamp. Thread-safe.
class Mirror final : public DistanceSource {
 public:
  // Returns at once; see WaitUntilReady. INVALID_ARGUMENT for options that cannot be.
  static absl::StatusOr<std::unique_ptr<Mirror>> Start(const MirrorOptions& options);
  ~Mirror() override;

  // As DistanceSource; UNAVAILABLE (with the reason) as long as there is no view.
  absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                            double horizon_s) const override;
  absl::StatusOr<DistanceAnswers> Distances(const Eigen::Matrix3Xd& points_W,
                                            const std::vector<float>& horizons_s) const override;
  // Of the options, map and pin_id are the server's alone: NOT_FOUND for a pin.
  absl::StatusOr<TrajectoryAnswers> CheckTrajectories(const std::vector<Sphere>& spheres,
                                                      const std::vector<Trajectory>& trajectories,
                                                      const CheckOptions& options) const override;
  absl::StatusOr<SphereAnswers> CheckSpheres(const std::vector<Sphere>& spheres,
                                             const std::vector<Pose>& T_W_R,
                                             const std::vector<double>& times_s,
                                             const CheckOptions& options) const override;
  absl::StatusOr<MapStamp> Stamp() const override;

  // DEADLINE_EXCEEDED, naming what is there and the last error.
  absl::Status WaitUntilReady(absl::Duration timeout) const;
  // Until the field includes `revision` of the epoch (0: whichever is current).
  absl::Status WaitForRevision(uint64_t revision, absl::Duration timeout, uint64_t epoch = 0) const;

  MirrorStatus Status() const;
  // The view that queries answer from; nullptr at first. Immutable.
  std::shared_ptr<const MapView> View() const;

 private:
  class Follower;
  explicit Mirror(std::unique_ptr<Follower> follower);
  absl::StatusOr<std::shared_ptr<const MapView>> ViewAtHand() const;
  absl::StatusOr<std::shared_ptr<const MapView>> ViewFor(const CheckOptions& options) const;

  std::unique_ptr<Follower> follower_;
};

}  // namespace clearance::client
