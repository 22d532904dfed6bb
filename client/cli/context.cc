#include "client/cli/context.h"

#include <cerrno>
#include <cstring>
#include <fstream>

#include "absl/strings/str_format.h"
#include "client/cli/connect.h"

namespace clearance::cli {

int ExitCodeOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kExitOk;
    case absl::StatusCode::kNotFound:
      return kExitNotFound;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kFailedPrecondition:
      return kExitBadData;
    case absl::StatusCode::kUnavailable:
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kAborted:
    case absl::StatusCode::kUnauthenticated:
    case absl::StatusCode::kPermissionDenied:
      return kExitUnavailable;
    case absl::StatusCode::kDeadlineExceeded:
      return kExitTimeout;
    default:
      return kExitInternal;
  }
}

absl::StatusOr<client::ClientOptions> ClientOptionsOf(const Context& context) {
  client::ClientOptions options;
  options.address = context.server;
  options.map = context.map;
  options.credentials = context.credentials;
  if (!context.token_file.empty()) {
    std::ifstream in(context.token_file);
    if (!(in >> options.credentials.token)) {
      return absl::NotFoundError(
          absl::StrFormat("--token-file %s: cannot be read, or is empty", context.token_file));
    }
  }
  const absl::Duration timeout = absl::Seconds(context.timeout_s);
  options.call_timeout = timeout;
  options.connect_timeout = std::min(options.connect_timeout, timeout);
  return options;
}

absl::StatusOr<std::unique_ptr<client::EsdfClient>> Context::Connect() const {
  const absl::StatusOr<client::ClientOptions> options = ClientOptionsOf(*this);
  if (!options.ok()) return options.status();
  return client::EsdfClient::Connect(*options);
}

absl::Status WriteFile(const std::string& path, std::string_view bytes) {
  errno = 0;
  std::ofstream out(path, std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (out) return absl::OkStatus();
  return absl::NotFoundError(absl::StrFormat("%s: cannot be written (%s); choose another --out",
                                             path, std::strerror(errno)));
}

}  // namespace clearance::cli
