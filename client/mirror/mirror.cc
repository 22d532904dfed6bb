#include "client/mirror/mirror.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/mirror/answers.h"
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

absl::StatusOr<DistanceAnswers> Mirror::Distances(const Eigen::Matrix3Xd& points_W,
                                                  double horizon_s) const {
  const std::shared_ptr<const MapView> view = View();
  if (view == nullptr) {
    return absl::UnavailableError(
        absl::StrFormat("the mirror has no map yet: %s", Status().last_error.message()));
  }
  return AnswerDistances(*view, points_W, horizon_s);
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
