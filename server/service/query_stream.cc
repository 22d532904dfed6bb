#include "server/service/query_stream.h"

#include <atomic>
#include <functional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/wire/frame.h"
#include "proto/wire/grpc_status.h"
#include "proto/wire/status_details.h"
#include "server/service/query_calls.h"

namespace clearance {
namespace {

void ToProto(const absl::Status& status, v1::Error* out) {
  out->set_code(static_cast<int>(status.code()));
  out->set_message(std::string(status.message()));
  if (absl::IsInvalidArgument(status)) {
    for (const Violation& violation : wire::ViolationsOf(status)) {
      wire::ToProto(violation, out->add_violations());
    }
  }
  if (const auto delay = wire::RetryDelayOf(status)) {
    out->set_retry_after_s(absl::ToDoubleSeconds(*delay));
  }
}

// A place in the stream for one answer.
template <typename Response>
class StreamReply final : public Reply<Response> {
 public:
  using Slot = Response* (v1::QueryStreamResponse::*)();

  StreamReply(std::shared_ptr<QueryStreamCall> stream, uint64_t tag, const char* method, Slot slot)
      : stream_(std::move(stream)), tag_(tag), method_(method), slot_(slot) {}

  void Finish(absl::StatusOr<Response> result) override {
    if (finished_.exchange(true)) return;
    stream_->Forget(this);
    const double ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started_at_)
            .count();
    stream_->service()->calls.Record(method_, result.status().code(), ms);
    v1::QueryStreamResponse response;
    response.set_tag(tag_);
    if (result.ok()) {
      *(response.*slot_)() = *std::move(result);
    } else {
      ToProto(result.status(), response.mutable_error());
    }
    stream_->Deliver(std::move(response));
  }
  bool done() const override { return finished_ || stream_->closed(); }
  void WhenCancelled(std::function<void()> hook) override {
    stream_->WhenCancelled(this, std::move(hook));
    if (finished_) stream_->Forget(this);
  }

 private:
  const std::shared_ptr<QueryStreamCall> stream_;
  const uint64_t tag_;
  const char* const method_;
  const Slot slot_;
  const std::chrono::steady_clock::time_point started_at_ = std::chrono::steady_clock::now();
  std::atomic<bool> finished_ = false;
};

}  // namespace

QueryStreamCall::QueryStreamCall(ServiceContext* service, const grpc::ServerContextBase* context)
    : service_(service), context_(context) {
  ++service_->open_streams;
}

QueryStreamCall::~QueryStreamCall() { --service_->open_streams; }

grpc::ServerBidiReactor<v1::QueryStreamRequest, v1::QueryStreamResponse>* QueryStreamCall::Start(
    ServiceContext* service, const grpc::ServerContextBase* context) {
  std::shared_ptr<QueryStreamCall> stream(new QueryStreamCall(service, context));
  stream->self_ = stream;
  stream->open_id_ = service->streams.Add([weak = std::weak_ptr<QueryStreamCall>(stream)] {
    if (const auto open = weak.lock()) open->EndForDrain();
  });
  stream->Advance();
  return stream.get();
}

void QueryStreamCall::OnReadDone(bool ok) {
  bool take = false;
  {
    MutexLock lock(&mu_);
    reading_ = false;
    if (!ok) no_more_ = true;
    take = ok && !no_more_ && !cancelled_;
    if (take) ++in_work_;
  }
  if (take) {
    // The next read comes after: its buffer is this one.
    v1::QueryStreamRequest request;
    request.Swap(&request_);
    Dispatch(request);
  }
  Advance();
}

void QueryStreamCall::Dispatch(const v1::QueryStreamRequest& request) {
  using Out = v1::QueryStreamResponse;
  const auto ask = [&]<typename Request, typename Response>(
                       const Request& asked, const char* method, Response* (Out::*slot)()) {
    auto reply =
        std::make_shared<StreamReply<Response>>(shared_from_this(), request.tag(), method, slot);
    // The stream was let in with the right on some map; each request needs it on its own.
    const absl::Status allowed =
        service_->access->Check(*context_, Right::kRead, OnMap(asked.map()));
    if (!allowed.ok()) return reply->Finish(allowed);
    clearance::Start(service_, asked, reply);
  };
  switch (request.request_case()) {
    case v1::QueryStreamRequest::kQueryPoints:
      return ask(request.query_points(), "QueryPoints", &Out::mutable_query_points);
    case v1::QueryStreamRequest::kCheckTrajectories:
      return ask(request.check_trajectories(), "CheckTrajectories",
                 &Out::mutable_check_trajectories);
    case v1::QueryStreamRequest::kCheckSpheres:
      return ask(request.check_spheres(), "CheckSpheres", &Out::mutable_check_spheres);
    case v1::QueryStreamRequest::kListObjects:
      return ask(request.list_objects(), "ListObjects", &Out::mutable_list_objects);
    case v1::QueryStreamRequest::kGetSlice:
      return ask(request.get_slice(), "GetSlice", &Out::mutable_get_slice);
    case v1::QueryStreamRequest::REQUEST_NOT_SET:
      break;
  }
  v1::QueryStreamResponse response;
  response.set_tag(request.tag());
  ToProto(wire::InvalidField("request", -1, "none that this server knows",
                             "query_points, check_trajectories, check_spheres, list_objects or "
                             "get_slice"),
          response.mutable_error());
  Deliver(std::move(response));
}

void QueryStreamCall::Deliver(v1::QueryStreamResponse response) {
  {
    MutexLock lock(&mu_);
    --in_work_;
    if (!cancelled_ && !finished_) answers_.push_back(std::move(response));
  }
  Advance();
}

void QueryStreamCall::OnWriteDone(bool ok) {
  {
    MutexLock lock(&mu_);
    writing_ = false;
    if (!ok) {
      cancelled_ = true;
      answers_.clear();
    }
  }
  Advance();
}

void QueryStreamCall::OnCancel() {
  std::map<const void*, std::function<void()>> hooks;
  {
    MutexLock lock(&mu_);
    cancelled_ = true;
    answers_.clear();
    hooks.swap(hooks_);
  }
  for (const auto& [owner, hook] : hooks) hook();
  Advance();
}

void QueryStreamCall::EndForDrain() {
  {
    MutexLock lock(&mu_);
    no_more_ = true;
    outcome_ = DrainingError();
  }
  Advance();
}

void QueryStreamCall::Advance() {
  MutexLock lock(&mu_);
  if (finished_) return;
  if (!writing_ && !answers_.empty()) {
    response_ = std::move(answers_.front());
    answers_.pop_front();
    writing_ = true;
    StartWrite(&response_);
  }
  if (!reading_ && !no_more_ && !cancelled_ &&
      in_work_ + answers_.size() + writing_ < service_->limits.max_stream_requests) {
    reading_ = true;
    StartRead(&request_);
  }
  if (writing_) return;
  if (!cancelled_ && !(no_more_ && in_work_ == 0 && answers_.empty())) return;
  finished_ = true;
  if (cancelled_) outcome_ = absl::CancelledError("the client cancelled");
  const double ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started_at_)
          .count();
  service_->calls.Record("QueryStream", outcome_.code(), ms);
  Finish(wire::ToGrpcStatus(outcome_));
}

bool QueryStreamCall::closed() const {
  MutexLock lock(&mu_);
  return cancelled_ || finished_;
}

void QueryStreamCall::WhenCancelled(const void* owner, std::function<void()> hook) {
  {
    MutexLock lock(&mu_);
    if (!cancelled_) {
      hooks_[owner] = std::move(hook);
      return;
    }
  }
  hook();
}

void QueryStreamCall::Forget(const void* owner) {
  std::function<void()> dropped;
  MutexLock lock(&mu_);
  const auto it = hooks_.find(owner);
  if (it == hooks_.end()) return;
  dropped = std::move(it->second);
  hooks_.erase(it);
}

void QueryStreamCall::OnDone() {
  service_->streams.Remove(open_id_);
  self_.reset();
}

}  // namespace clearance
