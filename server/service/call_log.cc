#include "server/service/call_log.h"

#include <grpcpp/server_context.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "server/engine/mutex.h"
#include "server/service/log.h"

namespace clearance {
namespace {

using Clock = std::chrono::steady_clock;
using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;

constexpr size_t kMaxIdBytes = 64;

std::string NewId() {
  thread_local std::mt19937_64 random{std::random_device{}()};
  return absl::StrFormat("%016x", random());
}

// So many lines a second. Thread-safe.
class Allowance {
 public:
  explicit Allowance(int per_second) : per_second_(per_second) {}

  // Whether the next line may go, and how many did not before it.
  bool Take(int* left_out) {
    MutexLock lock(&mu_);
    const Clock::time_point now = Clock::now();
    if (now - since_ >= std::chrono::seconds(1)) {
      since_ = now;
      taken_ = 0;
    }
    if (taken_ >= per_second_) {
      ++left_out_;
      return false;
    }
    ++taken_;
    *left_out = left_out_;
    left_out_ = 0;
    return true;
  }

 private:
  const int per_second_;
  Mutex mu_;
  Clock::time_point since_ ABSL_GUARDED_BY(mu_) = {};
  int taken_ ABSL_GUARDED_BY(mu_) = 0, left_out_ ABSL_GUARDED_BY(mu_) = 0;
};

class CallLog final : public grpc::experimental::Interceptor {
 public:
  CallLog(grpc::experimental::ServerRpcInfo* info, CallLogging logging, Allowance* allowance)
      : info_(info), logging_(logging), allowance_(allowance) {}

  void Intercept(InterceptorBatchMethods* batch) override {
    if (batch->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_INITIAL_METADATA)) {
      const auto& metadata = *batch->GetRecvInitialMetadata();
      const auto given = metadata.find(kRequestIdKey);
      if (given != metadata.end()) {
        const std::string_view id(given->second.data(), given->second.size());
        if (IsRequestId(id)) id_ = id;
      }
    }
    if (batch->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
      if (id_.empty()) id_ = NewId();
      batch->GetSendTrailingMetadata()->emplace(kRequestIdKey, id_);
      Ended(batch->GetSendStatus());
    }
    batch->Proceed();
  }

 private:
  void Ended(const grpc::Status& status) {
    if (logging_ == CallLogging::kNone || (logging_ == CallLogging::kFailed && status.ok())) return;
    int left_out = 0;
    if (!status.ok() && !allowance_->Take(&left_out)) return;
    const double ms = std::chrono::duration<double, std::milli>(Clock::now() - started_at_).count();
    nlohmann::ordered_json fields = {
        {"method", info_->method()},
        {"code", absl::StatusCodeToString(static_cast<absl::StatusCode>(status.error_code()))},
        {"ms", std::round(ms * 1e3) / 1e3},
        {"peer", info_->server_context()->peer()},
        {"request_id", id_}};
    if (!status.ok()) fields["error"] = status.error_message();
    if (left_out > 0) fields["calls_left_out_before"] = left_out;
    Log(status.ok() ? spdlog::level::info : spdlog::level::warn, "call", fields);
  }

  grpc::experimental::ServerRpcInfo* const info_;
  const CallLogging logging_;
  Allowance* const allowance_;
  const Clock::time_point started_at_ = Clock::now();
  std::string id_;
};

class Factory final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  Factory(CallLogging logging, int max_failed_per_s)
      : logging_(logging), allowance_(max_failed_per_s) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(
      grpc::experimental::ServerRpcInfo* info) override {
    return new CallLog(info, logging_, &allowance_);
  }

 private:
  const CallLogging logging_;
  Allowance allowance_;
};

}  // namespace

bool IsRequestId(std::string_view id) {
  return !id.empty() && id.size() <= kMaxIdBytes && std::all_of(id.begin(), id.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == ':' || c == '-';
  });
}

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> CallLogFactory(
    CallLogging logging, int max_failed_per_s) {
  return std::make_unique<Factory>(logging, max_failed_per_s);
}

}  // namespace clearance
