#include "server/service/region_stream.h"

#include <functional>
#include <utility>

#include "proto/wire/grpc_status.h"
#include "server/service/query_calls.h"
#include "server/service/resolve.h"

namespace clearance {

RegionStream::RegionStream(ServiceContext* service) : service_(service) {
  ++service_->open_streams;
}

RegionStream::~RegionStream() { --service_->open_streams; }

grpc::ServerWriteReactor<v1::GetRegionResponse>* RegionStream::Start(
    ServiceContext* service, const v1::GetRegionRequest& request) {
  std::shared_ptr<RegionStream> stream(new RegionStream(service));
  stream->self_ = stream;
  stream->Open(request);
  return stream.get();
}

void RegionStream::Open(const v1::GetRegionRequest& request) {
  open_id_ = service_->streams.Add([weak = weak_from_this()] {
    if (const auto stream = weak.lock()) stream->draining_ = true;
  });
  if (service_->draining) return Fail(DrainingError());
  const absl::StatusOr<wire::RegionQuery> query =
      wire::RegionQueryFromProto(request, WireLimits(service_->limits).query);
  if (!query.ok()) return Fail(query.status());
  const auto engine = service_->registry->Get(query->settings.map);
  if (!engine.ok()) return Fail(engine.status());
  const wire::Consistency& consistency = query->settings.consistency;
  if (absl::Status s = CheckConsistency(**engine, consistency); !s.ok()) return Fail(s);
  const uint64_t wait =
      WhenView(service_, *engine, consistency,
               [stream = shared_from_this(), query = *query](const absl::StatusOr<ViewPtr>& view) {
                 if (view.ok()) {
                   stream->Begin(*view, query);
                 } else {
                   stream->Fail(view.status());
                 }
               });
  if (wait == 0) return;
  MutexLock lock(&mu_);
  cancel_wait_ = [engine = *engine, wait] { engine->store().CancelWait(wait); };
}

void RegionStream::Begin(ViewPtr view, const wire::RegionQuery& query) {
  if (decided_.exchange(true)) return;
  absl::StatusOr<Region> region =
      Region::Make(std::move(view), query, service_->limits.max_region_cells);
  if (!region.ok()) return End(region.status());
  region_ = *std::move(region);
  PostNext();
}

void RegionStream::Fail(const absl::Status& status) {
  if (decided_.exchange(true)) return;
  End(status);
}

void RegionStream::PostNext() {
  const absl::Status posted =
      service_->pool->Post([stream = shared_from_this()] { stream->SendNext(); });
  if (!posted.ok()) End(posted);
}

void RegionStream::SendNext() {
  while (next_ < region_->blocks()) {
    if (cancelled_) return End(absl::CancelledError("the client cancelled"));
    if (draining_) return End(DrainingError());
    std::optional<v1::GetRegionResponse> block = region_->Block(next_++);
    if (!block) continue;
    block_ = *std::move(block);
    StartWrite(&block_);
    return;
  }
  End(absl::OkStatus());
}

void RegionStream::OnWriteDone(bool ok) {
  if (!ok) return End(absl::CancelledError("the client is gone"));
  PostNext();
}

void RegionStream::OnCancel() {
  cancelled_ = true;
  std::function<void()> cancel_wait;
  {
    MutexLock lock(&mu_);
    cancel_wait.swap(cancel_wait_);
  }
  if (cancel_wait) cancel_wait();
  Fail(absl::CancelledError("the client cancelled"));
}

void RegionStream::End(const absl::Status& status) {
  const double ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started_at_)
          .count();
  service_->calls.Record("GetRegion", status.code(), ms);
  Finish(wire::ToGrpcStatus(status));
}

void RegionStream::OnDone() {
  service_->streams.Remove(open_id_);
  self_.reset();
}

}  // namespace clearance
