// SnapshotService: maps on disk.
#pragma once

#include <functional>
#include <string>

#include "clearance/v1/snapshot.grpc.pb.h"
#include "server/service/ingest_sessions.h"
#include "server/service/service_context.h"

namespace clearance {

class SnapshotServiceImpl final : public v1::SnapshotService::CallbackService {
 public:
  // `serving_changed(map, serving)` keeps the health of `maps/<id>`.
  SnapshotServiceImpl(ServiceContext* service, IngestSessions* sessions,
                      std::function<void(const std::string&, bool)> serving_changed)
      : service_(service), sessions_(sessions), serving_changed_(std::move(serving_changed)) {}

  grpc::ServerUnaryReactor* CreateSnapshot(grpc::CallbackServerContext* context,
                                           const v1::CreateSnapshotRequest* request,
                                           v1::CreateSnapshotResponse* response) override;
  grpc::ServerUnaryReactor* ListSnapshots(grpc::CallbackServerContext* context,
                                          const v1::ListSnapshotsRequest* request,
                                          v1::ListSnapshotsResponse* response) override;
  grpc::ServerUnaryReactor* RestoreSnapshot(grpc::CallbackServerContext* context,
                                            const v1::RestoreSnapshotRequest* request,
                                            v1::RestoreSnapshotResponse* response) override;
  grpc::ServerUnaryReactor* DeleteSnapshot(grpc::CallbackServerContext* context,
                                           const v1::DeleteSnapshotRequest* request,
                                           v1::DeleteSnapshotResponse* response) override;

 private:
  ServiceContext* const service_;
  IngestSessions* const sessions_;
  const std::function<void(const std::string&, bool)> serving_changed_;
};

}  // namespace clearance
