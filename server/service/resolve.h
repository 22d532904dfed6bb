// From what a request asks for to the view and the time that answer it.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "clearance/v1/common.pb.h"
#include "proto/wire/query.h"
#include "server/engine/map_registry.h"
#include "server/query/query_options.h"
#include "server/service/reply.h"
#include "server/service/service_context.h"

namespace clearance {

void ToProto(const RevisionStamp& stamp, v1::MapStamp* out);

// Checks the epoch of `consistency` against the map. FAILED_PRECONDITION.
absl::Status CheckConsistency(const MappingEngine& engine, const wire::Consistency& consistency);

// Seconds after the view's stamp. OUT_OF_RANGE, stating stamp and limit, for a time before the
// stamp or beyond the map's max_horizon_s.
absl::StatusOr<double> ResolveHorizon(const MapView& view, const wire::QueryTime& time);
// The same for a time in seconds after the reference; `field` names it in errors.
absl::StatusOr<double> ResolveHorizon(const MapView& view, const wire::QueryTime& time,
                                      double seconds, std::string_view field);
// The same for one horizon a point, relative to the reference time.
absl::StatusOr<std::vector<float>> ResolveHorizons(const MapView& view, const wire::QueryTime& time,
                                                   const std::vector<float>& horizons_s);
// What relative times counted from.
int64_t ReferenceNs(const MapView& view, const wire::QueryTime& time);

// Settings that all queries share, for `view` at `horizon_s`. INVALID_ARGUMENT for a max_distance_m
// beyond the map's.
absl::StatusOr<QueryOptions> ResolveOptions(const MapView& view,
                                            const wire::QuerySettings& settings);

inline constexpr size_t kInlineCost = 4096;  // points that are answered on the transport's thread

// The view that `consistency` asks for where nothing is to be waited for: the pinned one, or the
// newest where it has reached min_revision, else null. NOT_FOUND for a pin that is not there,
// ABORTED for one that is older than min_revision.
absl::StatusOr<ViewPtr> ViewAtHand(ServiceContext* service, const MappingEngine& engine,
                                   const wire::Consistency& consistency);

// Calls `done` with the view that `consistency` asks for, once: now, or when it is reached, or with
// the error. Returns a wait to cancel; 0 where done.
uint64_t WhenView(ServiceContext* service, const MapRegistry::EnginePtr& engine,
                  const wire::Consistency& consistency, ViewCallback done);

// Finds the view that `map` and `consistency` ask for, computes the answer from it and finishes the
// call: on this thread where nothing is to be waited for and `cost` (points) is small, else on a
// worker. Waiting holds no thread.
template <typename Response>
void Answer(ServiceContext* service, const std::string& map, const wire::Consistency& consistency,
            size_t cost, std::shared_ptr<Reply<Response>> call,
            std::function<absl::StatusOr<Response>(const ViewPtr&)> compute) {
  if (service->draining) return call->Finish(DrainingError());
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service->registry->Get(map);
  if (!engine.ok()) return call->Finish(engine.status());
  if (absl::Status s = CheckConsistency(**engine, consistency); !s.ok()) return call->Finish(s);

  const auto on_worker = [service, call, compute](const ViewPtr& view) {
    const absl::Status posted = service->pool->Post([call, compute, view] {
      if (!call->done()) call->Finish(compute(view));
    });
    if (!posted.ok()) call->Finish(posted);
  };
  const absl::StatusOr<ViewPtr> at_hand = ViewAtHand(service, **engine, consistency);
  if (!at_hand.ok()) return call->Finish(at_hand.status());
  if (*at_hand != nullptr) {
    if (cost > kInlineCost) return on_worker(*at_hand);
    return call->Finish(compute(*at_hand));
  }
  const uint64_t wait = WhenView(service, *engine, consistency,
                                 [call, on_worker](const absl::StatusOr<ViewPtr>& view) {
                                   if (view.ok()) {
                                     on_worker(*view);
                                   } else {
                                     call->Finish(view.status());
                                   }
                                 });
  if (wait != 0) {
    call->WhenCancelled([engine = *engine, wait] { engine->store().CancelWait(wait); });
  }
}

}  // namespace clearance
