#include "server/service/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <unistd.h>

#include <array>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/config/server_config.h"
#include "server/service/access/gate.h"
#include "server/service/admin_service.h"
#include "server/service/export_service.h"
#include "server/service/ingest_service.h"
#include "server/service/listen_check.h"
#include "server/service/map_service.h"
#include "server/service/query_service.h"
#include "server/service/snapshot_service.h"
#include "server/service/watch_service.h"

namespace clearance {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kShutdownGrace{500};

void SetChannelArguments(const ServiceLimits& limits, grpc::ServerBuilder* builder) {
  builder->SetMaxReceiveMessageSize(static_cast<int>(limits.max_message_bytes));
  // Two servers on one port would share its connections at random.
  builder->AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  // Dead clients are found out; clients may ping as often as every 10 s, streams or not.
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 30'000);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10'000);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder->AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10'000);
}

}  // namespace

struct ClearanceServer::Services {
  Services(ServiceContext* context, std::function<void(const std::string&, bool)> serving_changed)
      : ingest(context, &sessions),
        query(context),
        map(context, &sessions, serving_changed),
        exports(context),
        admin(context),
        watch(context),
        snapshot(context, &sessions, serving_changed),
        gates(context, this) {}

  std::array<grpc::Service*, 7> All() {
    return {&gates.ingest, &gates.query, &gates.map,     &gates.exports,
            &gates.admin,  &gates.watch, &gates.snapshot};
  }

  IngestSessions sessions;
  IngestServiceImpl ingest;
  QueryServiceImpl query;
  MapServiceImpl map;
  ExportServiceImpl exports;
  AdminServiceImpl admin;
  WatchServiceImpl watch;
  SnapshotServiceImpl snapshot;

  // What the transport sees.
  struct Gates {
    Gates(const ServiceContext* context, Services* inner)
        : ingest(context, &inner->ingest),
          query(context, &inner->query),
          map(context, &inner->map),
          exports(context, &inner->exports),
          admin(context, &inner->admin),
          watch(context, &inner->watch),
          snapshot(context, &inner->snapshot) {}
    IngestGate ingest;
    QueryGate query;
    MapGate map;
    ExportGate exports;
    AdminGate admin;
    WatchGate watch;
    SnapshotGate snapshot;
  };
  Gates gates;
  std::unique_ptr<grpc::Server> grpc;
};

ClearanceServer::ClearanceServer(MapRegistry* registry, const ServerOptions& options,
                                 std::unique_ptr<Access> access)
    : options_(options),
      pool_(options.worker_threads, options.worker_queue),
      access_(std::move(access)) {
  context_.access = access_.get();
  context_.registry = registry;
  context_.pool = &pool_;
  context_.limits = options.limits;
  context_.settle = [this](std::chrono::milliseconds limit) {
    return Settle(Clock::now() + (limit.count() > 0 ? limit : options_.drain_timeout));
  };
  context_.pins = std::make_shared<PinTable>(options.limits.pins, &registry->timers());
  services_ = std::make_unique<Services>(
      &context_, [this](const std::string& map, bool serving) { SetMapServing(map, serving); });
}

ClearanceServer::~ClearanceServer() { Drain(); }

absl::StatusOr<std::unique_ptr<ClearanceServer>> ClearanceServer::Start(
    MapRegistry* registry, const ServerOptions& options) {
  auto access = std::make_unique<Access>();
  if (!options.access_file.empty()) {
    absl::StatusOr<std::unique_ptr<Access>> read = Access::FromFile(options.access_file);
    if (!read.ok()) return read.status();
    access = *std::move(read);
  }
  std::unique_ptr<ClearanceServer> server(
      new ClearanceServer(registry, options, std::move(access)));
  if (absl::Status s = server->Listen(); !s.ok()) return s;
  return server;
}

absl::Status ClearanceServer::Listen() {
  static const bool once = [] {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    return true;
  }();
  (void)once;
  grpc::ServerBuilder builder;
  SetChannelArguments(options_.limits, &builder);
  std::shared_ptr<grpc::ServerCredentials> tcp = grpc::InsecureServerCredentials();
  if (options_.tls.enabled()) {
    absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> tls = TlsCredentials(options_.tls);
    if (!tls.ok()) return tls.status();
    tcp = *std::move(tls);
  }
  std::vector<int> ports(options_.listen.size());
  for (size_t i = 0; i < options_.listen.size(); ++i) {
    const absl::StatusOr<HostPort> address = ParseHostPort(options_.listen[i], "listen");
    if (!address.ok()) return address.status();
    if (absl::Status s = CheckTcpAddress(address->host, address->port); !s.ok()) return s;
    builder.AddListeningPort(options_.listen[i], tcp, &ports[i]);
  }
  if (!options_.socket.empty()) {
    if (absl::Status s = CheckUnixSocket(options_.socket); !s.ok()) return s;
    builder.AddListeningPort("unix:" + options_.socket, grpc::InsecureServerCredentials());
  }
  for (grpc::Service* service : services_->All()) builder.RegisterService(service);
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> creators;
  creators.push_back(CallLogFactory(options_.log_calls));
  builder.experimental().SetInterceptorCreators(std::move(creators));
  services_->grpc = builder.BuildAndStart();
  if (!services_->grpc) {
    return absl::UnavailableError("cannot start the gRPC server: an address could not be bound");
  }
  for (size_t i = 0; i < ports.size(); ++i) {
    const std::string& wanted = options_.listen[i];
    addresses_.push_back(absl::StrFormat("%s:%d", wanted.substr(0, wanted.rfind(':')), ports[i]));
  }
  if (!options_.socket.empty()) addresses_.push_back("unix:" + options_.socket);

  if (context_.registry->loading()) {
    services_->grpc->GetHealthCheckService()->SetServingStatus(false);
    ShowServing(false);
  } else {
    Loaded();
  }
  return absl::OkStatus();
}

void ClearanceServer::Loaded() {
  services_->grpc->GetHealthCheckService()->SetServingStatus(true);
  ShowServing(true);
  for (const MapRegistry::EnginePtr& engine : context_.registry->List()) {
    SetMapServing(engine->id(), true);
  }
}

void ClearanceServer::ShowServing(bool serving) {
  grpc::HealthCheckServiceInterface* health = services_->grpc->GetHealthCheckService();
  health->SetServingStatus("", serving);
  for (const char* name : {"Ingest", "Query", "Map", "Export", "Admin", "Watch"}) {
    health->SetServingStatus(absl::StrFormat("clearance.v1.%sService", name), serving);
  }
  health->SetServingStatus("clearance.v1.SnapshotService", serving && context_.registry->durable());
}

std::shared_ptr<grpc::Channel> ClearanceServer::InProcessChannel() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  return services_->grpc->InProcessChannel(arguments);
}

void ClearanceServer::SetMapServing(const std::string& map, bool serving) {
  services_->grpc->GetHealthCheckService()->SetServingStatus("maps/" + map,
                                                             serving && !context_.draining);
}

bool ClearanceServer::Settle(Clock::time_point deadline) {
  context_.draining = true;
  services_->grpc->GetHealthCheckService()->SetServingStatus(false);
  context_.streams.EndAll();
  services_->sessions.CloseAll(v1::INGEST_CLOSING_REASON_DRAINING);
  const bool settled = context_.registry->Drain(deadline);
  services_->sessions.WaitEmpty(deadline);
  return settled;
}

bool ClearanceServer::Drain() {
  if (drained_ || !services_->grpc) return true;
  drained_ = true;
  const Clock::time_point deadline = Clock::now() + options_.drain_timeout;
  const bool settled = Settle(deadline);
  context_.registry->StopAll();  // what is left is abandoned, and its streams end
  services_->sessions.WaitEmpty(Clock::now() + kShutdownGrace);
  pool_.Stop();
  services_->grpc->Shutdown(std::chrono::system_clock::now() + kShutdownGrace);
  services_->grpc->Wait();
  if (!options_.socket.empty()) unlink(options_.socket.c_str());
  return settled;
}

}  // namespace clearance
