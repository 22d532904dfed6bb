#include "server/service/snapshot_service.h"

#include <utility>

#include "proto/wire/status_details.h"
#include "server/service/resolve.h"
#include "server/service/unary_call.h"

namespace clearance {
namespace {

void ToProto(const SnapshotManifest& manifest, v1::SnapshotInfo* out) {
  out->set_map(manifest.map);
  out->set_snapshot_id(manifest.snapshot_id);
  out->mutable_stamp()->set_revision(manifest.revision);
  out->mutable_stamp()->set_field_revision(manifest.field_revision);
  out->mutable_stamp()->set_epoch(manifest.epoch);
  out->mutable_stamp()->set_stamp_ns(manifest.stamp_ns);
  out->set_total_bytes(manifest.total_bytes());
  out->set_format_version(manifest.format_version);
  out->set_created_unix_ns(manifest.created_unix_ns);
  out->set_comment(manifest.comment);
}

v1::MapStamp StampNow(const MappingEngine& engine) {
  v1::MapStamp stamp;
  ToProto(StampOf(*engine.Latest()), &stamp);
  return stamp;
}

// The map's folder, for calls that need one.
absl::StatusOr<MapRegistry::EnginePtr> EngineOnDisk(ServiceContext* service,
                                                    const std::string& map) {
  absl::StatusOr<MapRegistry::EnginePtr> engine = service->registry->Get(map);
  if (engine.ok() && !(*engine)->folder()) {
    return absl::FailedPreconditionError(
        "snapshots need a folder: set store.dir in the server's configuration");
  }
  return engine;
}

// Runs `compute` on a worker: it reads and writes files.
template <typename Response>
grpc::ServerUnaryReactor* OnWorker(ServiceContext* service, const char* method, Response* response,
                                   std::function<absl::StatusOr<Response>()> compute) {
  auto call = UnaryCall<Response>::Start(service, method, response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::Status posted =
      service->draining
          ? DrainingError()
          : service->pool->Post([call, compute = std::move(compute)] { call->Finish(compute()); });
  if (!posted.ok()) call->Finish(posted);
  return reactor;
}

}  // namespace

grpc::ServerUnaryReactor* SnapshotServiceImpl::CreateSnapshot(
    grpc::CallbackServerContext*, const v1::CreateSnapshotRequest* request,
    v1::CreateSnapshotResponse* response) {
  auto call = UnaryCall<v1::CreateSnapshotResponse>::Start(service_, "CreateSnapshot", response);
  grpc::ServerUnaryReactor* reactor = call->reactor();
  const absl::StatusOr<MapRegistry::EnginePtr> engine = EngineOnDisk(service_, request->map());
  absl::Status status = service_->draining ? DrainingError() : engine.status();
  if (status.ok()) {
    status = service_->registry->CreateSnapshot(
        request->map(), request->snapshot_id(), request->comment(),
        [call, engine = *engine](const absl::StatusOr<SnapshotManifest>& manifest) {
          if (!manifest.ok()) return call->Finish(manifest.status());
          v1::CreateSnapshotResponse created;
          ToProto(*manifest, created.mutable_snapshot());
          *created.mutable_stamp() = StampNow(*engine);
          call->Finish(std::move(created));
        });
  }
  if (absl::IsResourceExhausted(status)) status = wire::WithRetry(status, absl::Seconds(1));
  if (!status.ok()) call->Finish(std::move(status));
  return reactor;
}

grpc::ServerUnaryReactor* SnapshotServiceImpl::ListSnapshots(
    grpc::CallbackServerContext*, const v1::ListSnapshotsRequest* request,
    v1::ListSnapshotsResponse* response) {
  return OnWorker<v1::ListSnapshotsResponse>(
      service_, "ListSnapshots", response,
      [this, map = request->map()]() -> absl::StatusOr<v1::ListSnapshotsResponse> {
        const absl::StatusOr<MapRegistry::EnginePtr> engine = EngineOnDisk(service_, map);
        if (!engine.ok()) return engine.status();
        v1::ListSnapshotsResponse list;
        for (const SnapshotManifest& manifest : (*engine)->folder()->Snapshots()) {
          ToProto(manifest, list.add_snapshots());
        }
        *list.mutable_stamp() = StampNow(**engine);
        return list;
      });
}

grpc::ServerUnaryReactor* SnapshotServiceImpl::RestoreSnapshot(
    grpc::CallbackServerContext*, const v1::RestoreSnapshotRequest* request,
    v1::RestoreSnapshotResponse* response) {
  return OnWorker<v1::RestoreSnapshotResponse>(
      service_, "RestoreSnapshot", response,
      [this, map = request->map(),
       id = request->snapshot_id()]() -> absl::StatusOr<v1::RestoreSnapshotResponse> {
        const absl::StatusOr<MapRegistry::EnginePtr> old = EngineOnDisk(service_, map);
        if (!old.ok()) return old.status();
        const absl::StatusOr<MapRegistry::EnginePtr> engine =
            service_->registry->RestoreSnapshot(map, id, [&] {
              serving_changed_((*old)->id(), false);
              sessions_->CloseMap((*old)->id(), v1::INGEST_CLOSING_REASON_RESTORED);
            });
        serving_changed_((*old)->id(), true);
        if (!engine.ok()) return engine.status();
        v1::RestoreSnapshotResponse restored;
        *restored.mutable_stamp() = StampNow(**engine);
        return restored;
      });
}

grpc::ServerUnaryReactor* SnapshotServiceImpl::DeleteSnapshot(
    grpc::CallbackServerContext*, const v1::DeleteSnapshotRequest* request,
    v1::DeleteSnapshotResponse* response) {
  return OnWorker<v1::DeleteSnapshotResponse>(
      service_, "DeleteSnapshot", response,
      [this, map = request->map(),
       id = request->snapshot_id()]() -> absl::StatusOr<v1::DeleteSnapshotResponse> {
        const absl::StatusOr<MapRegistry::EnginePtr> engine = EngineOnDisk(service_, map);
        if (!engine.ok()) return engine.status();
        if (absl::Status s = ValidateSnapshotId(id); !s.ok()) return s;
        if (absl::Status s = (*engine)->folder()->DeleteSnapshot(id); !s.ok()) return s;
        v1::DeleteSnapshotResponse deleted;
        *deleted.mutable_stamp() = StampNow(**engine);
        return deleted;
      });
}

}  // namespace clearance
