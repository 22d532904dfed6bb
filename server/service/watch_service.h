// WatchService, and SnapshotService: declared, not offered yet.
#pragma once

#include "clearance/v1/snapshot.grpc.pb.h"
#include "clearance/v1/watch.grpc.pb.h"
#include "server/service/unimplemented.h"
#include "server/service/watch_hub.h"

namespace clearance {

class WatchServiceImpl final : public v1::WatchService::CallbackService {
 public:
  explicit WatchServiceImpl(ServiceContext* service) : hub_(service) {}

  grpc::ServerWriteReactor<v1::WatchMapResponse>* WatchMap(
      grpc::CallbackServerContext*, const v1::WatchMapRequest* request) override {
    return hub_.Start(*request);
  }

 private:
  WatchHub hub_;
};

class SnapshotServiceImpl final : public v1::SnapshotService::CallbackService {
 public:
  grpc::ServerUnaryReactor* CreateSnapshot(grpc::CallbackServerContext* context,
                                           const v1::CreateSnapshotRequest*,
                                           v1::CreateSnapshotResponse*) override {
    return UnaryNotOffered(context, "CreateSnapshot");
  }
  grpc::ServerUnaryReactor* ListSnapshots(grpc::CallbackServerContext* context,
                                          const v1::ListSnapshotsRequest*,
                                          v1::ListSnapshotsResponse*) override {
    return UnaryNotOffered(context, "ListSnapshots");
  }
  grpc::ServerUnaryReactor* RestoreSnapshot(grpc::CallbackServerContext* context,
                                            const v1::RestoreSnapshotRequest*,
                                            v1::RestoreSnapshotResponse*) override {
    return UnaryNotOffered(context, "RestoreSnapshot");
  }
  grpc::ServerUnaryReactor* DeleteSnapshot(grpc::CallbackServerContext* context,
                                           const v1::DeleteSnapshotRequest*,
                                           v1::DeleteSnapshotResponse*) override {
    return UnaryNotOffered(context, "DeleteSnapshot");
  }
};

}  // namespace clearance
