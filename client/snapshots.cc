// Snapshots on the server's disk.
#include <grpcpp/client_context.h>

#include <chrono>

#include "clearance/v1/snapshot.grpc.pb.h"
#include "client/channel.h"
#include "client/connection.h"
#include "client/convert.h"

namespace clearance::client {
namespace {

using Stub = v1::SnapshotService::Stub;

template <typename Connection, typename Request, typename Reply>
absl::Status Call(const Connection& connection,
                  grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Reply*),
                  const Request& request, Reply* reply) {
  const auto stub = v1::SnapshotService::NewStub(connection.channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() +
                       absl::ToChronoMicroseconds(connection.options.call_timeout));
  return CallStatus((stub.get()->*method)(&context, request, reply), connection.options.address);
}

SnapshotInfo FromProto(const v1::SnapshotInfo& info) {
  SnapshotInfo result;
  result.map = info.map();
  result.snapshot_id = info.snapshot_id();
  result.comment = info.comment();
  result.stamp = client::FromProto(info.stamp());
  result.total_bytes = info.total_bytes();
  result.format_version = info.format_version();
  result.created_unix_ns = info.created_unix_ns();
  return result;
}

}  // namespace

absl::StatusOr<SnapshotInfo> EsdfClient::CreateSnapshot(const std::string& map,
                                                        const std::string& snapshot_id,
                                                        const std::string& comment) const {
  v1::CreateSnapshotRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_snapshot_id(snapshot_id);
  request.set_comment(comment);
  v1::CreateSnapshotResponse reply;
  absl::Status status = Call(*connection_, &Stub::CreateSnapshot, request, &reply);
  if (!status.ok()) return status;
  return FromProto(reply.snapshot());
}

absl::StatusOr<std::vector<SnapshotInfo>> EsdfClient::ListSnapshots(const std::string& map) const {
  v1::ListSnapshotsRequest request;
  request.set_map(connection_->MapOr(map));
  v1::ListSnapshotsResponse reply;
  absl::Status status = Call(*connection_, &Stub::ListSnapshots, request, &reply);
  if (!status.ok()) return status;
  std::vector<SnapshotInfo> list;
  for (const v1::SnapshotInfo& info : reply.snapshots()) list.push_back(FromProto(info));
  return list;
}

absl::StatusOr<MapStamp> EsdfClient::RestoreSnapshot(const std::string& map,
                                                     const std::string& snapshot_id) const {
  v1::RestoreSnapshotRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_snapshot_id(snapshot_id);
  v1::RestoreSnapshotResponse reply;
  absl::Status status = Call(*connection_, &Stub::RestoreSnapshot, request, &reply);
  if (!status.ok()) return status;
  return client::FromProto(reply.stamp());
}

absl::Status EsdfClient::DeleteSnapshot(const std::string& map,
                                        const std::string& snapshot_id) const {
  v1::DeleteSnapshotRequest request;
  request.set_map(connection_->MapOr(map));
  request.set_snapshot_id(snapshot_id);
  v1::DeleteSnapshotResponse reply;
  return Call(*connection_, &Stub::DeleteSnapshot, request, &reply);
}

}  // namespace clearance::client
