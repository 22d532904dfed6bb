#include "server/service/resolve.h"

#include "absl/numeric/int128.h"
#include "absl/strings/str_format.h"
#include "proto/wire/status_details.h"

namespace clearance {
namespace {

double SecondsBetween(int64_t from_ns, int64_t to_ns) {
  return static_cast<double>(absl::int128(to_ns) - absl::int128(from_ns)) * 1e-9;
}

absl::Status CheckHorizon(const MapView& view, double horizon_s, std::string_view field) {
  if (horizon_s < 0) {
    return absl::OutOfRangeError(absl::StrFormat(
        "%s: the asked time is %.9g s before the map's stamp %d ns; expected 0 to %g "
        "s after it",
        field, -horizon_s, view.stamp_ns, view.config.max_horizon_s));
  }
  if (horizon_s > view.config.max_horizon_s) {
    return absl::OutOfRangeError(
        absl::StrFormat("%s: the asked time is %.9g s after the map's stamp %d ns; limit %g s",
                        field, horizon_s, view.stamp_ns, view.config.max_horizon_s));
  }
  return absl::OkStatus();
}

}  // namespace

void ToProto(const RevisionStamp& stamp, v1::MapStamp* out) {
  out->set_revision(stamp.revision);
  out->set_field_revision(stamp.field_revision);
  out->set_epoch(stamp.epoch);
  out->set_stamp_ns(stamp.stamp_ns);
  out->set_staleness_s(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - stamp.published_at).count());
}

absl::Status CheckConsistency(const MappingEngine& engine, const wire::Consistency& consistency) {
  if (consistency.epoch != 0 && consistency.epoch != engine.epoch()) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "consistency.epoch: got %d, map '%s' is in epoch %d: it was restarted, restored or created "
        "anew. Read its revision again",
        consistency.epoch, engine.id(), engine.epoch()));
  }
  return absl::OkStatus();
}

absl::StatusOr<ViewPtr> ViewAtHand(ServiceContext* service, const MappingEngine& engine,
                                   const wire::Consistency& consistency) {
  if (consistency.pin_id == 0) {
    const ViewPtr latest = engine.Latest();
    return latest->field_revision >= consistency.min_revision ? latest : nullptr;
  }
  absl::StatusOr<ViewPtr> pinned =
      service->pins->Find(engine.id(), engine.epoch(), consistency.pin_id);
  if (pinned.ok() && (*pinned)->field_revision < consistency.min_revision) {
    return absl::AbortedError(absl::StrFormat(
        "consistency.min_revision: got %d, but pin %d of map '%s' keeps field revision %d. Lower "
        "min_revision, or pin a newer revision",
        consistency.min_revision, consistency.pin_id, engine.id(), (*pinned)->field_revision));
  }
  return pinned;
}

uint64_t WhenView(ServiceContext* service, const MapRegistry::EnginePtr& engine,
                  const wire::Consistency& consistency, ViewCallback done) {
  absl::StatusOr<ViewPtr> at_hand = ViewAtHand(service, *engine, consistency);
  if (!at_hand.ok() || *at_hand != nullptr) {
    done(std::move(at_hand));
    return 0;
  }
  const auto deadline = std::chrono::steady_clock::now() +
                        std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                            std::chrono::duration<double>(consistency.wait_s));
  return engine->store().WhenFieldRevision(consistency.min_revision, deadline, std::move(done));
}

int64_t ReferenceNs(const MapView& view, const wire::QueryTime& time) {
  return time.reference_ns.value_or(view.stamp_ns);
}

absl::StatusOr<double> ResolveHorizon(const MapView& view, const wire::QueryTime& time) {
  const double horizon_s =
      time.at_ns ? SecondsBetween(view.stamp_ns, *time.at_ns)
                 : SecondsBetween(view.stamp_ns, ReferenceNs(view, time)) + time.horizon_s;
  if (absl::Status s = CheckHorizon(view, horizon_s, time.at_ns ? "at_ns" : "horizon_s"); !s.ok()) {
    return s;
  }
  return horizon_s;
}

absl::StatusOr<double> ResolveHorizon(const MapView& view, const wire::QueryTime& time,
                                      double seconds, std::string_view field) {
  const double horizon_s = SecondsBetween(view.stamp_ns, ReferenceNs(view, time)) + seconds;
  if (absl::Status s = CheckHorizon(view, horizon_s, field); !s.ok()) return s;
  return horizon_s;
}

absl::StatusOr<std::vector<float>> ResolveHorizons(const MapView& view, const wire::QueryTime& time,
                                                   const std::vector<float>& horizons_s) {
  const double reference_s = SecondsBetween(view.stamp_ns, ReferenceNs(view, time));
  std::vector<float> resolved(horizons_s.size());
  for (size_t i = 0; i < horizons_s.size(); ++i) {
    const double horizon_s = reference_s + horizons_s[i];
    if (absl::Status s = CheckHorizon(view, horizon_s, absl::StrFormat("horizons_f32[%d]", i));
        !s.ok()) {
      return s;
    }
    resolved[i] = static_cast<float>(horizon_s);
  }
  return resolved;
}

absl::StatusOr<QueryOptions> ResolveOptions(const MapView& view,
                                            const wire::QuerySettings& settings) {
  // A little above is rounding of the same number, not a wish for more.
  if (settings.max_distance_m > view.config.max_distance_m * (1 + 1e-6)) {
    return wire::InvalidField("max_distance_m", -1, absl::StrFormat("%g", settings.max_distance_m),
                              absl::StrFormat("at most the map's %g", view.config.max_distance_m));
  }
  const absl::StatusOr<double> horizon_s = ResolveHorizon(view, settings.time);
  if (!horizon_s.ok()) return horizon_s.status();
  QueryOptions options;
  options.horizon_s = *horizon_s;
  options.fusion = settings.weighted_fusion ? Fusion::kWeighted : Fusion::kMin;
  options.layers = {settings.layers.static_only, settings.layers.only_objects,
                    settings.layers.without_objects};
  options.max_distance_m = settings.max_distance_m;
  options.sigma_margin = settings.sigma_margin;
  options.now = std::chrono::steady_clock::now();
  return options;
}

}  // namespace clearance
