#include "server/service/map_service.h"

#include <utility>

#include "proto/wire/status_details.h"
#include "server/service/map_replies.h"
#include "server/service/resolve.h"
#include "server/service/unary_call.h"
#include "server/service/unimplemented.h"

namespace clearance {
namespace {

// Runs `compute` on a worker: it may wait for a mapping thread.
template <typename Response>
void OnWorker(ServiceContext* service, std::shared_ptr<UnaryCall<Response>> call,
              std::function<absl::StatusOr<Response>()> compute) {
  const absl::Status posted =
      service->pool->Post([call, compute = std::move(compute)] { call->Finish(compute()); });
  if (!posted.ok()) call->Finish(posted);
}

}  // namespace

grpc::ServerUnaryReactor* MapServiceImpl::CreateMap(grpc::CallbackServerContext*,
                                                    const v1::CreateMapRequest* request,
                                                    v1::CreateMapResponse* response) {
  auto call = UnaryCall<v1::CreateMapResponse>::Start(service_, "CreateMap", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::StatusOr<MapConfig> config =
      MapConfigFromProto(request->config(), service_->limits.map_defaults);
  if (service_->draining) {
    call->Finish(DrainingError());
  } else if (!config.ok()) {
    call->Finish(config.status());
  } else {
    OnWorker<v1::CreateMapResponse>(
        service_, call,
        [this, id = request->map(), config = *config]() -> absl::StatusOr<v1::CreateMapResponse> {
          const absl::StatusOr<MapRegistry::EnginePtr> engine =
              service_->registry->Create(id, config);
          if (absl::IsResourceExhausted(engine.status())) {
            return wire::WithRetry(engine.status(), absl::Seconds(10));
          }
          if (!engine.ok()) return engine.status();
          serving_changed_((*engine)->id(), true);
          v1::CreateMapResponse created;
          FillMapInfo(**engine, false, created.mutable_info());
          return created;
        });
  }
  return reactor;
}

grpc::ServerUnaryReactor* MapServiceImpl::GetMap(grpc::CallbackServerContext*,
                                                 const v1::GetMapRequest* request,
                                                 v1::GetMapResponse* response) {
  auto call = UnaryCall<v1::GetMapResponse>::Start(service_, "GetMap", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Get(request->map());
  if (!engine.ok()) {
    call->Finish(engine.status());
    return reactor;
  }
  v1::GetMapResponse found;
  FillMapInfo(**engine, request->include_trajectory(), found.mutable_info());
  call->Finish(std::move(found));
  return reactor;
}

grpc::ServerUnaryReactor* MapServiceImpl::ListMaps(grpc::CallbackServerContext*,
                                                   const v1::ListMapsRequest*,
                                                   v1::ListMapsResponse* response) {
  auto call = UnaryCall<v1::ListMapsResponse>::Start(service_, "ListMaps", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  v1::ListMapsResponse list;
  for (const MapRegistry::EnginePtr& engine : service_->registry->List()) {
    FillMapInfo(*engine, false, list.add_maps());
  }
  call->Finish(std::move(list));
  return reactor;
}

grpc::ServerUnaryReactor* MapServiceImpl::DeleteMap(grpc::CallbackServerContext*,
                                                    const v1::DeleteMapRequest* request,
                                                    v1::DeleteMapResponse* response) {
  auto call = UnaryCall<v1::DeleteMapResponse>::Start(service_, "DeleteMap", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  OnWorker<v1::DeleteMapResponse>(
      service_, call, [this, id = request->map()]() -> absl::StatusOr<v1::DeleteMapResponse> {
        const absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Delete(id);
        if (!engine.ok()) return engine.status();
        serving_changed_((*engine)->id(), false);
        sessions_->CloseMap((*engine)->id(), v1::INGEST_CLOSING_REASON_DELETED);
        v1::DeleteMapResponse deleted;
        ToProto(StampOf(*(*engine)->Latest()), deleted.mutable_stamp());
        return deleted;
      });
  return reactor;
}

grpc::ServerUnaryReactor* MapServiceImpl::EditRegion(grpc::CallbackServerContext*,
                                                     const v1::EditRegionRequest* request,
                                                     v1::EditRegionResponse* response) {
  auto call = UnaryCall<v1::EditRegionResponse>::Start(service_, "EditRegion", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::StatusOr<RegionEdit> edit = RegionEditFromProto(*request);
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Get(request->map());
  absl::Status status = edit.status();
  if (status.ok()) status = engine.status();
  if (status.ok() && service_->draining) status = DrainingError();
  if (status.ok()) {
    status = (*engine)->EditRegion(
        *edit, [call](absl::StatusOr<MapModel::Edited> edited, const RevisionStamp& stamp) {
          if (!edited.ok()) return call->Finish(edited.status());
          v1::EditRegionResponse done;
          ToProto(stamp, done.mutable_stamp());
          done.set_changed_voxels(edited->changed_voxels);
          call->Finish(std::move(done));
        });
    if (absl::IsResourceExhausted(status)) {
      status = wire::WithRetry(std::move(status), absl::Milliseconds(500));
    }
  }
  if (!status.ok()) call->Finish(std::move(status));
  return reactor;
}

grpc::ServerUnaryReactor* MapServiceImpl::RepositionSubmaps(grpc::CallbackServerContext* context,
                                                            const v1::RepositionSubmapsRequest*,
                                                            v1::RepositionSubmapsResponse*) {
  return UnaryNotOffered(context, "RepositionSubmaps");
}

}  // namespace clearance
