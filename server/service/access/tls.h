// TLS for the server's TCP addresses.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace clearance {

// Paths of PEM files. No certificate = plain text.
struct TlsFiles {
  std::string certificate;  // the server's chain, leaf first
  std::string key;
  std::string client_ca;  // set: clients must show a certificate that it signed

  bool enabled() const { return !certificate.empty(); }
};

// Read now and again every few seconds: renewed certificates serve the next connection.
// NOT_FOUND or INVALID_ARGUMENT naming the file and what is wrong with it.
absl::StatusOr<std::shared_ptr<grpc::ServerCredentials>> TlsCredentials(const TlsFiles& files);

}  // namespace clearance
