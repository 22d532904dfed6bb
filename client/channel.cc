#include "client/channel.h"

#include <grpcpp/client_context.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/client_interceptor.h>

#include <chrono>
#include <fstream>
#include <sstream>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "proto/wire/grpc_status.h"

namespace clearance::client {
namespace {

constexpr int kMaxMessageBytes = 16 << 20;

// A path means a unix socket.
std::string Target(const std::string& address) {
  if (absl::StartsWith(address, "/") || absl::StartsWith(address, "./")) {
    return absl::StrCat("unix:", address);
  }
  return address;
}

// The last, most telling part of gRPC's chain of causes: "... last error: UNKNOWN: ...: Connection
// refused".
std::string Cause(const std::string& message) {
  const size_t colon = message.rfind(": ");
  return colon == std::string::npos ? message : message.substr(colon + 2);
}

absl::Status Unreachable(const std::string& address, const std::string& cause,
                         absl::Duration waited) {
  return absl::UnavailableError(absl::StrFormat(
      "cannot reach the server at %s within %s (%s); is clearance_server running there? Start it, "
      "or name another with --server or CLEARANCE_SERVER",
      address, absl::FormatDuration(waited), cause));
}

absl::StatusOr<std::string> ReadPem(const std::string& path, const char* what) {
  if (path.empty()) return std::string();
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in || text.str().find("-----BEGIN ") == std::string::npos) {
    return absl::NotFoundError(
        absl::StrFormat("%s %s: cannot be read, or holds nothing in PEM format", what, path));
  }
  return text.str();
}

absl::StatusOr<std::shared_ptr<grpc::ChannelCredentials>> MakeCredentials(const Credentials& of) {
  if (of.tls_certificate.empty() != of.tls_key.empty()) {
    return absl::InvalidArgumentError("TLS certificate and key: got one of them, expected both");
  }
  if (of.tls_ca.empty()) {
    if (of.tls_certificate.empty()) return grpc::InsecureChannelCredentials();
    return absl::InvalidArgumentError(
        "TLS certificate: needs the server's authority (TLS CA), too");
  }
  grpc::SslCredentialsOptions options;
  const struct {
    const std::string& path;
    const char* what;
    std::string* pem;
  } files[] = {{of.tls_ca, "TLS CA", &options.pem_root_certs},
               {of.tls_certificate, "TLS certificate", &options.pem_cert_chain},
               {of.tls_key, "TLS key", &options.pem_private_key}};
  for (const auto& file : files) {
    absl::StatusOr<std::string> pem = ReadPem(file.path, file.what);
    if (!pem.ok()) return pem.status();
    *file.pem = *std::move(pem);
  }
  return grpc::SslCredentials(options);
}

// gRPC attaches call credentials to secure channels only; a unix socket needs none and may ask for
// a token all the same.
class TokenInterceptor final : public grpc::experimental::Interceptor {
 public:
  explicit TokenInterceptor(const std::string& header) : header_(header) {}
  void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
    using grpc::experimental::InterceptionHookPoints;
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_INITIAL_METADATA)) {
      methods->GetSendInitialMetadata()->emplace("authorization", header_);
    }
    methods->Proceed();
  }

 private:
  const std::string header_;
};

class TokenInterceptorFactory final : public grpc::experimental::ClientInterceptorFactoryInterface {
 public:
  explicit TokenInterceptorFactory(const std::string& token) : header_("Bearer " + token) {}
  grpc::experimental::Interceptor* CreateClientInterceptor(
      grpc::experimental::ClientRpcInfo*) override {
    return new TokenInterceptor(header_);
  }

 private:
  const std::string header_;
};

}  // namespace

absl::StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const std::string& address,
                                                           const Credentials& credentials,
                                                           absl::Duration timeout) {
  const std::string target = Target(address);
  const bool has_port = target.rfind(':') != std::string::npos && target.back() != ':';
  if (!has_port) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "server address: got \"%s\", expected HOST:PORT, unix:PATH or the path of a socket",
        address));
  }
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
  // A server that vanished without a word is found out while a call runs.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 10'000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 5'000);
  // Loopback and sockets never go through an HTTP proxy of the environment.
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  if (!credentials.tls_server_name.empty()) {
    arguments.SetSslTargetNameOverride(credentials.tls_server_name);
  }
  const auto channel_credentials = MakeCredentials(credentials);
  if (!channel_credentials.ok()) return channel_credentials.status();
  std::vector<std::unique_ptr<grpc::experimental::ClientInterceptorFactoryInterface>> interceptors;
  if (!credentials.token.empty()) {
    interceptors.push_back(std::make_unique<TokenInterceptorFactory>(credentials.token));
  }
  auto channel = grpc::experimental::CreateCustomChannelWithInterceptors(
      target, *channel_credentials, arguments, std::move(interceptors));
  const auto deadline = std::chrono::system_clock::now() + absl::ToChronoMicroseconds(timeout);
  if (channel->WaitForConnected(deadline)) return channel;
  // WaitForConnected does not say why; a call does.
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(500));
  grpc::health::v1::HealthCheckResponse response;
  const grpc::Status status =
      grpc::health::v1::Health::NewStub(channel)->Check(&context, {}, &response);
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE) {
    return Unreachable(address, Cause(status.error_message()), timeout);
  }
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED) {
    return Unreachable(address, "no answer", timeout);
  }
  return channel;  // connected a moment later
}

absl::Status CallStatus(const grpc::Status& status, const std::string& address) {
  const absl::Status result = wire::FromGrpcStatus(status);
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE && status.error_details().empty()) {
    return absl::UnavailableError(absl::StrFormat(
        "the server at %s is not available (%s); is clearance_server running there?", address,
        Cause(status.error_message())));
  }
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED) {
    return absl::DeadlineExceededError(
        absl::StrFormat("the server at %s did not answer in time (%s); try a longer --timeout",
                        address, status.error_message()));
  }
  return result;
}

}  // namespace clearance::client
