#include "server/service/watch_stream.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/geometry.h"
#include "proto/wire/grpc_status.h"
#include "proto/wire/ids.h"
#include "proto/wire/status_details.h"

namespace clearance {

absl::StatusOr<WatchRequest> WatchRequestFromProto(const v1::WatchMapRequest& request) {
  WatchRequest result;
  absl::StatusOr<std::string> map = wire::NameFromProto(request.map(), "map");
  if (!map.ok()) return map.status();
  result.map = *std::move(map);
  result.epoch = request.epoch();
  result.revision = request.revision();
  result.selection.poses_only = request.poses_only();
  if (request.has_bounds()) {
    const absl::StatusOr<Aabb> bounds = wire::BoxFromProto(request.bounds(), "bounds");
    if (!bounds.ok()) return bounds.status();
    result.selection.bounds = *bounds;
  }
  result.max_rate_hz = request.max_rate_hz();
  if (!std::isfinite(result.max_rate_hz) || result.max_rate_hz < 0) {
    return wire::InvalidField("max_rate_hz", -1, absl::StrFormat("%g", result.max_rate_hz),
                              "finite and not negative; 0 = every revision");
  }
  return result;
}

std::shared_ptr<WatchStream> WatchStream::Start(
    ServiceContext* service, WatchRequest request,
    std::function<void(std::shared_ptr<WatchStream>)> ready) {
  std::shared_ptr<WatchStream> stream(
      new WatchStream(service, std::move(request), std::move(ready)));
  stream->self_ = stream;
  ++service->open_streams;
  return stream;
}

void WatchStream::OnWriteDone(bool ok) {
  if (!ok) gone_ = true;
  writing_ = false;
  ready_(shared_from_this());
}

void WatchStream::OnCancel() {
  gone_ = true;
  ready_(shared_from_this());
}

void WatchStream::OnDone() {
  --service_->open_streams;
  self_.reset();
}

void WatchStream::Write(Message message) {
  message_ = std::move(message);
  writing_ = true;
  StartWrite(message_.get());
}

void WatchStream::End(const absl::Status& status) {
  finished_ = true;
  telling.reset();
  shared.clear();
  const double ms = std::chrono::duration<double, std::milli>(Clock::now() - started_at_).count();
  service_->calls.Record("WatchMap", status.code(), ms);
  Finish(wire::ToGrpcStatus(status));
}

}  // namespace clearance
