#include "client/mirror/mirror.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/mirror/answers.h"
#include "client/mirror/check_answers.h"
#include "client/mirror/follower.h"
#include "proto/wire/status_details.h"

namespace clearance::client {
namespace {

absl::Status CheckNotNegative(double value, const char* field) {
  if (std::isfinite(value) && value >= 0) return absl::OkStatus();
  return wire::InvalidField(field, -1, absl::StrFormat("%g", value), "finite and not negative");
}

}  // namespace

absl::StatusOr<std::unique_ptr<Mirror>> Mirror::Start(const MirrorOptions& options) {
  for (const absl::Status& status : {CheckNotNegative(options.max_rate_hz, "max_rate_hz"),
                                     CheckNotNegative(options.stale_after_s, "stale_after_s")}) {
    if (!status.ok()) return status;
  }
  if (options.bounds && options.bounds->isEmpty()) {
    return wire::InvalidField("bounds", -1, "an empty box", "min <= max in every axis");
  }
  if (options.first_backoff <= absl::ZeroDuration() ||
      options.max_backoff < options.first_backoff) {
    return wire::InvalidField("first_backoff", -1, absl::FormatDuration(options.first_backoff),
                              "above 0 and at most max_backoff");
  }
  return std::unique_ptr<Mirror>(new Mirror(std::make_unique<Follower>(options)));
}

Mirror::Mirror(std::unique_ptr<Follower> follower) : follower_(std::move(follower)) {}
Mirror::~Mirror() = default;

absl::StatusOr<std::shared_ptr<const MapView>> Mirror::ViewAtHand() const {
  std::shared_ptr<const MapView> view = View();
  if (view != nullptr) return view;
  return absl::UnavailableError(
      absl::StrFormat("the mirror has no map yet: %s", Status().last_error.message()));
}

absl::StatusOr<std::shared_ptr<const MapView>> Mirror::ViewFor(const CheckOptions& options) const {
  if (options.pin_id != 0) {
    return absl::NotFoundError(absl::StrFormat(
        "pin_id: a mirror does not know pin %d; pins are the server's", options.pin_id));
  }
  if (options.min_revision != 0) {
    const absl::Status reached =
        WaitForRevision(options.min_revision, absl::Seconds(options.wait_s), options.epoch);
    if (!reached.ok()) return absl::AbortedError(reached.message());
  }
  absl::StatusOr<std::shared_ptr<const MapView>> view = ViewAtHand();
  if (view.ok() && options.epoch != 0 && (*view)->epoch != options.epoch) {
    return absl::FailedPreconditionError(
        absl::StrFormat("epoch: got %d, the mirror is in epoch %d: the map was restarted, restored "
                        "or created anew. Read its revision again",
                        options.epoch, (*view)->epoch));
  }
  return view;
}

absl::StatusOr<DistanceAnswers> Mirror::Distances(const Eigen::Matrix3Xd& points_W,
                                                  double horizon_s) const {
  const auto view = ViewAtHand();
  if (!view.ok()) return view.status();
  return AnswerDistances(**view, points_W, horizon_s, {});
}

absl::StatusOr<DistanceAnswers> Mirror::Distances(const Eigen::Matrix3Xd& points_W,
                                                  const std::vector<float>& horizons_s) const {
  const auto view = ViewAtHand();
  if (!view.ok()) return view.status();
  return AnswerDistances(**view, points_W, 0, horizons_s);
}

absl::StatusOr<TrajectoryAnswers> Mirror::CheckTrajectories(
    const std::vector<Sphere>& spheres, const std::vector<Trajectory>& trajectories,
    const CheckOptions& options) const {
  const auto view = ViewFor(options);
  if (!view.ok()) return view.status();
  return AnswerTrajectories(**view, spheres, trajectories, options);
}

absl::StatusOr<SphereAnswers> Mirror::CheckSpheres(const std::vector<Sphere>& spheres,
                                                   const std::vector<Pose>& T_W_R,
                                                   const std::vector<double>& times_s,
                                                   const CheckOptions& options) const {
  const auto view = ViewFor(options);
  if (!view.ok()) return view.status();
  return AnswerSpheres(**view, spheres, T_W_R, times_s, options);
}

absl::StatusOr<MapStamp> Mirror::Stamp() const {
  const auto view = ViewAtHand();
  if (!view.ok()) return view.status();
  return MapStampOf(**view);
}

absl::Status Mirror::WaitUntilReady(absl::Duration timeout) const {
  return follower_->WaitFor(0, 0, timeout);
}

absl::Status Mirror::WaitForRevision(uint64_t revision, absl::Duration timeout,
                                     uint64_t epoch) const {
  return follower_->WaitFor(revision, epoch, timeout);
}

MirrorStatus Mirror::Status() const { return follower_->Status(); }

std::shared_ptr<const MapView> Mirror::View() const { return follower_->View(); }

}  // namespace clearance::client
