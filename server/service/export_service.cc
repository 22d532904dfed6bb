#include "server/service/export_service.h"

#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/wire/query.h"
#include "proto/wire/status_details.h"
#include "server/service/chunk_stream.h"
#include "server/service/grid_export.h"
#include "server/service/mesh_export.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

// Waits for what `consistency` asks, then runs `task` between two frames of the map.
template <typename Response>
void OnMap(ServiceContext* service, const std::string& map, const v1::Consistency& wanted,
           std::shared_ptr<ChunkStream<Response>> stream, MappingEngine::Task task) {
  if (service->draining) return stream->Fail(DrainingError());
  wire::QueryLimits limits;
  limits.max_wait_s = service->limits.max_wait_s;
  const absl::StatusOr<wire::Consistency> consistency =
      wire::ConsistencyFromProto(wanted, limits, "consistency");
  if (!consistency.ok()) return stream->Fail(consistency.status());
  if (consistency->pin_id != 0) {
    return stream->Fail(wire::InvalidField("consistency.pin_id", -1,
                                           absl::StrCat(consistency->pin_id),
                                           "0: exports are made from the newest revision"));
  }
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service->registry->Get(map);
  if (!engine.ok()) return stream->Fail(engine.status());
  if (absl::Status s = CheckConsistency(**engine, *consistency); !s.ok()) return stream->Fail(s);
  const auto deadline = std::chrono::steady_clock::now() +
                        std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                            std::chrono::duration<double>(consistency->wait_s));
  (*engine)->store().WhenFieldRevision(
      consistency->min_revision, deadline,
      [stream, engine = *engine, task = std::move(task)](const absl::StatusOr<ViewPtr>& view) {
        if (!view.ok()) return stream->Fail(view.status());
        absl::Status posted = engine->Post(task);
        if (absl::IsResourceExhausted(posted)) {
          posted = wire::WithRetry(std::move(posted), absl::Seconds(1));
        }
        if (!posted.ok()) stream->Fail(posted);
      });
}

}  // namespace

grpc::ServerWriteReactor<v1::ExportMeshResponse>* ExportServiceImpl::ExportMesh(
    grpc::CallbackServerContext*, const v1::ExportMeshRequest* request) {
  auto stream = ChunkStream<v1::ExportMeshResponse>::Start(service_, "ExportMesh");
  const absl::StatusOr<MeshSelection> selection = MeshSelectionFromProto(*request);
  if (!selection.ok()) {
    stream->Fail(selection.status());
    return stream.get();
  }
  const auto task = [service = service_, stream, selection = *selection](MapModel* model,
                                                                         const ViewPtr& view) {
    if (stream->done()) return;
    if (model == nullptr) return stream->Fail(DrainingError());
    absl::StatusOr<MeshCopy> copy = TakeMesh(selection, model, *view);
    if (!copy.ok()) return stream->Fail(copy.status());
    auto taken = std::make_shared<const MeshCopy>(*std::move(copy));
    const absl::Status posted = service->pool->Post([stream, selection, taken] {
      stream->Send(WriteMesh(selection, *taken), MeshHeader(*taken),
                   [&](v1::ExportMeshResponse* first) { FillFirst(selection, *taken, first); });
    });
    if (!posted.ok()) stream->Fail(posted);
  };
  OnMap(service_, request->map(), request->consistency(), stream, task);
  return stream.get();
}

grpc::ServerWriteReactor<v1::ExportGridResponse>* ExportServiceImpl::ExportGrid(
    grpc::CallbackServerContext*, const v1::ExportGridRequest* request) {
  auto stream = ChunkStream<v1::ExportGridResponse>::Start(service_, "ExportGrid");
  const absl::StatusOr<GridSelection> selection = GridSelectionFromProto(*request);
  if (!selection.ok()) {
    stream->Fail(selection.status());
    return stream.get();
  }
  const auto task = [service = service_, stream, selection = *selection](MapModel* model,
                                                                         const ViewPtr& view) {
    if (stream->done()) return;
    if (model == nullptr) return stream->Fail(DrainingError());
    const auto copy = GridCopy::Take(selection, model, view);
    if (!copy.ok()) return stream->Fail(copy.status());
    const absl::Status posted = service->pool->Post([stream, copy = *copy] {
      absl::StatusOr<std::string> file = copy->Write();
      if (!file.ok()) return stream->Fail(file.status());
      v1::ExportGridResponse header;
      ToProto(StampOf(copy->view()), header.mutable_stamp());
      stream->Send(*std::move(file), std::move(header), nullptr);
    });
    if (!posted.ok()) stream->Fail(posted);
  };
  OnMap(service_, request->map(), request->consistency(), stream, task);
  return stream.get();
}

}  // namespace clearance
