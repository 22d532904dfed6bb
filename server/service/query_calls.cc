#include "server/service/query_calls.h"

#include <utility>

#include "proto/wire/ids.h"
#include "server/service/check_replies.h"
#include "server/service/query_replies.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

constexpr size_t kWorkerCost = kInlineCost + 1;
// Costs in points of a plain look-up: searching for unknown space costs far more, and so does the
// way between two poses.
constexpr size_t kUnknownCost = 16, kStateCost = 16;

}  // namespace

wire::CheckLimits WireLimits(const ServiceLimits& limits) {
  wire::CheckLimits wire_limits;
  wire_limits.query.max_points = limits.max_query_points;
  wire_limits.query.max_wait_s = limits.max_wait_s;
  wire_limits.max_trajectories = limits.max_trajectories;
  wire_limits.max_waypoints = limits.max_waypoints;
  wire_limits.max_spheres = limits.max_spheres;
  return wire_limits;
}

void Start(ServiceContext* service, const v1::QueryPointsRequest& request,
           std::shared_ptr<Reply<v1::QueryPointsResponse>> reply) {
  absl::StatusOr<wire::PointsQuery> decoded =
      wire::PointsQueryFromProto(request, WireLimits(service->limits).query);
  if (!decoded.ok()) return reply->Finish(decoded.status());
  auto query = std::make_shared<const wire::PointsQuery>(*std::move(decoded));
  const size_t cost = query->points_W.cols() * (query->unknown_distances ? kUnknownCost : 1);
  Answer<v1::QueryPointsResponse>(
      service, query->settings.map, query->settings.consistency, cost, std::move(reply),
      [query](const ViewPtr& view) { return AnswerPoints(*view, *query); });
}

void Start(ServiceContext* service, const v1::CheckTrajectoriesRequest& request,
           std::shared_ptr<Reply<v1::CheckTrajectoriesResponse>> reply) {
  absl::StatusOr<wire::TrajectoriesQuery> decoded =
      wire::TrajectoriesQueryFromProto(request, WireLimits(service->limits));
  if (!decoded.ok()) return reply->Finish(decoded.status());
  auto query = std::make_shared<const wire::TrajectoriesQuery>(*std::move(decoded));
  size_t waypoints = 0;
  for (const wire::TimedPath& path : query->trajectories) waypoints += path.T_W_R.size();
  const wire::QuerySettings& settings = query->check.settings;
  const auto cancelled = [reply] { return reply->done(); };
  Answer<v1::CheckTrajectoriesResponse>(service, settings.map, settings.consistency,
                                        waypoints * query->check.spheres.size() * kStateCost,
                                        std::move(reply), [query, cancelled](const ViewPtr& view) {
                                          return AnswerTrajectories(*view, *query, cancelled);
                                        });
}

void Start(ServiceContext* service, const v1::CheckSpheresRequest& request,
           std::shared_ptr<Reply<v1::CheckSpheresResponse>> reply) {
  absl::StatusOr<wire::SpheresQuery> decoded =
      wire::SpheresQueryFromProto(request, WireLimits(service->limits));
  if (!decoded.ok()) return reply->Finish(decoded.status());
  auto query = std::make_shared<const wire::SpheresQuery>(*std::move(decoded));
  const wire::QuerySettings& settings = query->check.settings;
  const auto cancelled = [reply] { return reply->done(); };
  Answer<v1::CheckSpheresResponse>(
      service, settings.map, settings.consistency,
      query->T_W_R.size() * query->check.spheres.size() * kUnknownCost, std::move(reply),
      [query, cancelled](const ViewPtr& view) { return AnswerSpheres(*view, *query, cancelled); });
}

void Start(ServiceContext* service, const v1::ListObjectsRequest& request,
           std::shared_ptr<Reply<v1::ListObjectsResponse>> reply) {
  const absl::StatusOr<wire::ObjectsQuery> query =
      wire::ObjectsQueryFromProto(request, WireLimits(service->limits).query);
  if (!query.ok()) return reply->Finish(query.status());
  Answer<v1::ListObjectsResponse>(
      service, query->settings.map, query->settings.consistency,
      query->include_history ? kWorkerCost : 0, std::move(reply),
      [query = *query](const ViewPtr& view) { return AnswerObjects(*view, query); });
}

void Start(ServiceContext* service, const v1::GetSliceRequest& request,
           std::shared_ptr<Reply<v1::GetSliceResponse>> reply) {
  const absl::StatusOr<wire::SliceQuery> query =
      wire::SliceQueryFromProto(request, WireLimits(service->limits).query);
  if (!query.ok()) return reply->Finish(query.status());
  Answer<v1::GetSliceResponse>(
      service, query->settings.map, query->settings.consistency, kWorkerCost, std::move(reply),
      [query = *query, cells = service->limits.max_slice_cells](const ViewPtr& view) {
        return AnswerSlice(*view, query, cells);
      });
}

void Start(ServiceContext* service, const v1::PinRevisionRequest& request,
           std::shared_ptr<Reply<v1::PinRevisionResponse>> reply) {
  const absl::StatusOr<wire::PinQuery> query =
      wire::PinQueryFromProto(request, WireLimits(service->limits).query);
  if (!query.ok()) return reply->Finish(query.status());
  Answer<v1::PinRevisionResponse>(
      service, query->settings.map, query->settings.consistency, 0, std::move(reply),
      [service, query = *query](const ViewPtr& reached) -> absl::StatusOr<v1::PinRevisionResponse> {
        ViewPtr view = reached;
        if (query.revision != 0 && query.revision != view->revision) {
          const auto engine = service->registry->Get(query.settings.map);
          if (!engine.ok()) return engine.status();
          absl::StatusOr<ViewPtr> found = (*engine)->store().Find(query.revision);
          if (!found.ok()) return found.status();
          view = *std::move(found);
        }
        const absl::StatusOr<PinTable::Pin> pin =
            service->pins->Add(query.settings.map, view, query.ttl_s);
        if (!pin.ok()) return pin.status();
        v1::PinRevisionResponse response;
        ToProto(StampOf(*view), response.mutable_stamp());
        response.set_pin_id(pin->id);
        response.set_ttl_s(pin->ttl_s);
        return response;
      });
}

void Start(ServiceContext* service, const v1::ReleasePinRequest& request,
           std::shared_ptr<Reply<v1::ReleasePinResponse>> reply) {
  const absl::StatusOr<std::string> map = wire::NameFromProto(request.map(), "map");
  if (!map.ok()) return reply->Finish(map.status());
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service->registry->Get(*map);
  if (!engine.ok()) return reply->Finish(engine.status());
  const absl::StatusOr<ViewPtr> released =
      service->pins->Release(*map, (*engine)->epoch(), request.pin_id());
  if (!released.ok()) return reply->Finish(released.status());
  v1::ReleasePinResponse response;
  ToProto(StampOf(**released), response.mutable_stamp());
  reply->Finish(std::move(response));
}

}  // namespace clearance
