// The gRPC server: all services on TCP, a unix socket or in process, health, reflection, drain.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/service/access/tls.h"
#include "server/service/call_log.h"
#include "server/service/service_context.h"

namespace grpc {
class Channel;
}

namespace clearance {

struct ServerOptions {
  std::vector<std::string> listen;  // HOST:PORT; port 0 = any free one
  std::string socket;               // path of a unix socket; empty = none
  TlsFiles tls;                     // of the TCP addresses
  std::string access_file;          // empty = whoever can connect may do everything
  CallLogging log_calls = CallLogging::kNone;
  ServiceLimits limits;
  int worker_threads = 2;
  size_t worker_queue = 256;
  std::chrono::milliseconds drain_timeout{8000};
};

class ClearanceServer {
 public:
  // UNAVAILABLE naming the address where it cannot be bound (for example because it is in use).
  // NOT_FOUND or INVALID_ARGUMENT for a bad certificate, key or access file. `registry` outlives
  // the server.
  static absl::StatusOr<std::unique_ptr<ClearanceServer>> Start(MapRegistry* registry,
                                                                const ServerOptions& options);
  ~ClearanceServer();  // drains

  // Where it listens, with the ports that were chosen.
  const std::vector<std::string>& addresses() const { return addresses_; }
  // For tests: no port, no network.
  std::shared_ptr<grpc::Channel> InProcessChannel();
  // Keeps the health of maps/<id> for maps that are made beside the MapService.
  void SetMapServing(const std::string& map, bool serving);
  // The registry has recovered its maps: serves from now on. Start does it where there is nothing
  // to recover.
  void Loaded();
  ServiceContext& context() { return context_; }

  // NOT_SERVING at once; ingest streams settle, get their acks and IngestClosing; running calls
  // finish; then the server stops, and all maps with it. False where frames were left unsettled at
  // the timeout. Idempotent.
  bool Drain();
  // The first half of it: afterwards calls are answered with UNAVAILABLE. Thread-safe.
  bool Settle(std::chrono::steady_clock::time_point deadline);

 private:
  struct Services;

  ClearanceServer(MapRegistry* registry, const ServerOptions& options,
                  std::unique_ptr<Access> access);
  absl::Status Listen();
  void ShowServing(bool serving);

  const ServerOptions options_;
  WorkerPool pool_;
  std::unique_ptr<Access> access_;
  ServiceContext context_;
  std::vector<std::string> addresses_;
  std::unique_ptr<Services> services_;
  bool drained_ = false;
};

}  // namespace clearance
