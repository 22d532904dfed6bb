#include "server/service/http/http_server.h"

#include <thread>

#include "absl/strings/str_format.h"
#include "server/config/server_config.h"
#include "server/service/http/metrics.h"
#include "server/service/listen_check.h"

// Last: it brings <resolv.h>, whose macro _res is a name inside Eigen.
#include <httplib.h>

namespace clearance {
namespace {

constexpr int kThreads = 2;
constexpr int kKeepAliveSeconds = 2;  // an idle connection holds a thread for this long
constexpr size_t kMaxPayloadBytes = 4096;

}  // namespace

struct HttpServer::Impl {
  httplib::Server server;
  std::thread thread;
};

HttpServer::HttpServer() : impl_(std::make_unique<Impl>()) {}

HttpServer::~HttpServer() {
  impl_->server.stop();
  if (impl_->thread.joinable()) impl_->thread.join();
}

absl::StatusOr<std::unique_ptr<HttpServer>> HttpServer::Start(const std::string& address,
                                                              const ServiceContext* service) {
  const absl::StatusOr<HostPort> parsed = ParseHostPort(address, "server.http");
  if (!parsed.ok()) return parsed.status();
  if (absl::Status s = CheckTcpAddress(parsed->host, parsed->port); !s.ok()) return s;
  std::unique_ptr<HttpServer> http(new HttpServer);
  httplib::Server& server = http->impl_->server;
  server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  server.set_keep_alive_timeout(kKeepAliveSeconds);
  server.set_payload_max_length(kMaxPayloadBytes);
  // The library's default lets two servers share one port.
  server.set_socket_options([](socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
  });
  server.Get("/healthz", [](const httplib::Request&, httplib::Response& response) {
    response.set_content("ok\n", "text/plain");
  });
  server.Get("/readyz", [service](const httplib::Request&, httplib::Response& response) {
    const char* state = service->draining              ? "draining\n"
                        : service->registry->loading() ? "loading\n"
                                                       : "ready\n";
    response.status = std::string_view(state) == "ready\n" ? 200 : 503;
    response.set_content(state, "text/plain");
  });
  server.Get("/metrics", [service](const httplib::Request&, httplib::Response& response) {
    response.set_content(MetricsText(*service), "text/plain; version=0.0.4");
  });
  int port = parsed->port;
  const bool bound = port == 0 ? (port = server.bind_to_any_port(parsed->host)) > 0
                               : server.bind_to_port(parsed->host, port);
  if (!bound) {
    return absl::UnavailableError(absl::StrFormat("cannot listen on %s for HTTP", address));
  }
  http->address_ = absl::StrFormat("%s:%d", address.substr(0, address.rfind(':')), port);
  http->impl_->thread = std::thread([&server] { server.listen_after_bind(); });
  // stop() before the loop runs would be lost.
  while (!server.is_running()) std::this_thread::yield();
  return http;
}

}  // namespace clearance
