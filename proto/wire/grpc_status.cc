#include "proto/wire/grpc_status.h"

#include <string>

#include "absl/strings/cord.h"
#include "absl/strings/string_view.h"
#include "google/rpc/status.pb.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

constexpr size_t kMaxMessageBytes = 4096;
constexpr size_t kMaxDetailsBytes = 2048;

}  // namespace

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  // Loading, draining, stopping: it is always worth another try.
  if (absl::IsUnavailable(status) && !RetryDelayOf(status)) {
    return ToGrpcStatus(WithRetry(status, absl::Seconds(1)));
  }
  const std::string message(status.message().substr(0, kMaxMessageBytes));
  google::rpc::Status details;
  status.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) {
    auto* any = details.add_details();
    any->set_type_url(std::string(url));
    any->set_value(std::string(payload));
  });
  std::string bytes;
  if (details.details_size() > 0) {
    details.set_code(static_cast<int>(status.code()));
    details.set_message(message);
    bytes = details.SerializeAsString();
    if (bytes.size() > kMaxDetailsBytes) bytes.clear();
  }
  return grpc::Status(static_cast<grpc::StatusCode>(status.code()), message, bytes);
}

absl::Status FromGrpcStatus(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  absl::Status result(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
  google::rpc::Status details;
  if (!status.error_details().empty() && details.ParseFromString(status.error_details())) {
    for (const auto& any : details.details()) {
      result.SetPayload(any.type_url(), absl::Cord(any.value()));
    }
  }
  return result;
}

}  // namespace clearance::wire
