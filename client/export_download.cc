// Files in checked chunks.
#include <grpcpp/client_context.h>

#include <chrono>

#include "absl/strings/str_format.h"
#include "client/channel.h"
#include "client/connection.h"
#include "client/convert.h"
#include "server/core/crc32c.h"

namespace clearance::client {
namespace {

// Drains a stream of chunks into the sink; on_chunk sees every message.
template <typename Chunk, typename OnChunk>
absl::Status Download(grpc::ClientContext& context, grpc::ClientReader<Chunk>& reader,
                      const std::string& address, const ByteSink& sink, OnChunk on_chunk) {
  uint64_t offset = 0, total = 0;
  absl::Status status;
  for (Chunk chunk; status.ok() && reader.Read(&chunk);) {
    if (chunk.offset() != offset) {
      status = absl::DataLossError(
          absl::StrFormat("export: got a chunk at byte %d, expected %d", chunk.offset(), offset));
    } else if (Crc32c(chunk.data()) != chunk.crc32c()) {
      status = absl::DataLossError(
          absl::StrFormat("export: the chunk at byte %d has a wrong checksum", offset));
    } else {
      on_chunk(chunk);
      offset += chunk.data().size();
      total = chunk.total_bytes();
      status = sink(chunk.data());
    }
  }
  if (!status.ok()) context.TryCancel();
  const grpc::Status finished = reader.Finish();
  if (!status.ok()) return status;
  if (!finished.ok()) return CallStatus(finished, address);
  if (offset != total) {
    return absl::DataLossError(
        absl::StrFormat("export: the file ended at byte %d of %d", offset, total));
  }
  return absl::OkStatus();
}

template <typename Request>
void SetTarget(const std::optional<uint32_t>& object_id, Request* request) {
  if (object_id) {
    request->set_object_id(*object_id);
  } else {
    request->mutable_static_map();
  }
}

std::chrono::system_clock::time_point Deadline(const ClientOptions& options) {
  return std::chrono::system_clock::now() + absl::ToChronoMicroseconds(options.export_timeout);
}

}  // namespace

absl::StatusOr<ExportResult> EsdfClient::ExportMesh(const MeshOptions& options,
                                                    const ByteSink& sink) const {
  v1::ExportMeshRequest request;
  request.set_map(connection_->MapOr(options.map));
  SetTarget(options.object_id, &request);
  request.set_format(options.glb ? v1::MESH_FORMAT_GLB : v1::MESH_FORMAT_PLY);
  request.set_frame(options.object_frame ? v1::MESH_FRAME_OBJECT : v1::MESH_FRAME_WORLD);
  grpc::ClientContext context;
  context.set_deadline(Deadline(connection_->options));
  ExportResult result;
  const auto reader = connection_->exporter->ExportMesh(&context, request);
  absl::Status status = Download<v1::ExportMeshResponse>(
      context, *reader, connection_->options.address, sink, [&](const auto& chunk) {
        result.stamp = FromProto(chunk.stamp());
        result.bytes += chunk.data().size();
        result.vertices += chunk.vertices();
        result.triangles += chunk.triangles();
      });
  if (!status.ok()) return status;
  return result;
}

absl::StatusOr<ExportResult> EsdfClient::ExportGrid(const GridOptions& options,
                                                    const ByteSink& sink) const {
  v1::ExportGridRequest request;
  request.set_map(connection_->MapOr(options.map));
  SetTarget(options.object_id, &request);
  for (const GridKind kind : options.kinds) request.add_kinds(static_cast<v1::GridKind>(kind));
  grpc::ClientContext context;
  context.set_deadline(Deadline(connection_->options));
  ExportResult result;
  const auto reader = connection_->exporter->ExportGrid(&context, request);
  absl::Status status = Download<v1::ExportGridResponse>(
      context, *reader, connection_->options.address, sink, [&](const auto& chunk) {
        result.stamp = FromProto(chunk.stamp());
        result.bytes += chunk.data().size();
      });
  if (!status.ok()) return status;
  return result;
}

}  // namespace clearance::client
