// /healthz, /readyz and /metrics over HTTP.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/service/service_context.h"

namespace clearance {

// Serves on threads of its own until destroyed.
class HttpServer {
 public:
  // `address` is HOST:PORT; port 0 = any free one. UNAVAILABLE naming the address where it cannot
  // be bound. `service` outlives the server.
  static absl::StatusOr<std::unique_ptr<HttpServer>> Start(const std::string& address,
                                                           const ServiceContext* service);
  ~HttpServer();

  const std::string& address() const { return address_; }

 private:
  struct Impl;
  HttpServer();

  std::unique_ptr<Impl> impl_;
  std::string address_;
};

}  // namespace clearance
