// Every RPC passes here before its handler: this file is the table of what each needs.
#pragma once

#include <grpcpp/support/server_callback.h>

#include "clearance/v1/admin.grpc.pb.h"
#include "clearance/v1/export.grpc.pb.h"
#include "clearance/v1/ingest.grpc.pb.h"
#include "clearance/v1/map.grpc.pb.h"
#include "clearance/v1/query.grpc.pb.h"
#include "clearance/v1/snapshot.grpc.pb.h"
#include "clearance/v1/watch.grpc.pb.h"
#include "server/service/access/access.h"
#include "server/service/access/refusal.h"
#include "server/service/service_context.h"

namespace clearance {

// A service that asks Access first and then passes the call on to `inner`. An RPC that is not
// listed below answers UNIMPLEMENTED: nothing is open by omission. Streams whose messages name
// their map are let in with the right on some map; their handlers check each map. Streams of every
// kind need room, too: limits.max_streams.
template <typename Service>
class ServiceGate : public Service::CallbackService {
 public:
  ServiceGate(const ServiceContext* service, typename Service::CallbackService* inner)
      : service_(service), inner_(inner) {}

 protected:
  absl::Status CheckStream(const grpc::ServerContextBase& context, Right right,
                           const auto& scope) const {
    if (absl::Status s = service_->access->Check(context, right, scope); !s.ok()) return s;
    return CheckRoomForStream(*service_);
  }

  const ServiceContext* const service_;
  typename Service::CallbackService* const inner_;
};

#define CLEARANCE_UNARY(Rpc, right, scope)                                                    \
  grpc::ServerUnaryReactor* Rpc(grpc::CallbackServerContext* context,                         \
                                const v1::Rpc##Request* request, v1::Rpc##Response* response) \
      override {                                                                              \
    const absl::Status allowed = service_->access->Check(*context, Right::right, scope);      \
    if (!allowed.ok()) return RefuseUnary(context, allowed);                                  \
    return inner_->Rpc(context, request, response);                                           \
  }
#define CLEARANCE_WRITES(Rpc, right, scope)                                                    \
  grpc::ServerWriteReactor<v1::Rpc##Response>* Rpc(grpc::CallbackServerContext* context,       \
                                                   const v1::Rpc##Request* request) override { \
    const absl::Status allowed = CheckStream(*context, Right::right, scope);                   \
    if (!allowed.ok()) return RefuseWrites<v1::Rpc##Response>(allowed);                        \
    return inner_->Rpc(context, request);                                                      \
  }
#define CLEARANCE_STREAM(Rpc, right, scope)                                               \
  grpc::ServerBidiReactor<v1::Rpc##Request, v1::Rpc##Response>* Rpc(                      \
      grpc::CallbackServerContext* context) override {                                    \
    const absl::Status allowed = CheckStream(*context, Right::right, scope);              \
    if (!allowed.ok()) return RefuseStream<v1::Rpc##Request, v1::Rpc##Response>(allowed); \
    return inner_->Rpc(context);                                                          \
  }

struct IngestGate final : ServiceGate<v1::IngestService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_STREAM(IngestFrames, kIngest, OnSomeMap())
  CLEARANCE_UNARY(IngestFrame, kIngest, OnMap(request->map()))
};

struct QueryGate final : ServiceGate<v1::QueryService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_UNARY(QueryPoints, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(CheckTrajectories, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(CheckSpheres, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(ListObjects, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(GetSlice, kRead, OnMap(request->map()))
  CLEARANCE_WRITES(GetRegion, kRead, OnMap(request->map()))
  CLEARANCE_STREAM(QueryStream, kRead, OnSomeMap())
  CLEARANCE_UNARY(PinRevision, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(ReleasePin, kRead, OnMap(request->map()))
};

struct MapGate final : ServiceGate<v1::MapService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_UNARY(CreateMap, kAdmin, OnMap(request->map()))
  CLEARANCE_UNARY(GetMap, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(ListMaps, kRead, OnEveryMap())
  CLEARANCE_UNARY(DeleteMap, kAdmin, OnMap(request->map()))
  CLEARANCE_UNARY(EditRegion, kAdmin, OnMap(request->map()))
  CLEARANCE_UNARY(RepositionSubmaps, kAdmin, OnMap(request->map()))
};

struct ExportGate final : ServiceGate<v1::ExportService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_WRITES(ExportMesh, kRead, OnMap(request->map()))
  CLEARANCE_WRITES(ExportGrid, kRead, OnMap(request->map()))
};

struct WatchGate final : ServiceGate<v1::WatchService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_WRITES(WatchMap, kRead, OnMap(request->map()))
};

struct SnapshotGate final : ServiceGate<v1::SnapshotService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_UNARY(CreateSnapshot, kAdmin, OnMap(request->map()))
  CLEARANCE_UNARY(ListSnapshots, kRead, OnMap(request->map()))
  CLEARANCE_UNARY(RestoreSnapshot, kAdmin, OnMap(request->map()))
  CLEARANCE_UNARY(DeleteSnapshot, kAdmin, OnMap(request->map()))
};

struct AdminGate final : ServiceGate<v1::AdminService> {
  using ServiceGate::ServiceGate;
  CLEARANCE_UNARY(GetServerInfo, kRead, OnSomeMap())
  CLEARANCE_UNARY(GetStats, kRead, request->map().empty() ? OnEveryMap() : OnMap(request->map()))
  CLEARANCE_UNARY(Drain, kAdmin, OnEveryMap())
};

#undef CLEARANCE_UNARY
#undef CLEARANCE_WRITES
#undef CLEARANCE_STREAM

}  // namespace clearance
