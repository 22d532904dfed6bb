// GetRegion: one block is computed, sent and taken before the next is begun.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "clearance/v1/query.pb.h"
#include "server/service/region_reply.h"
#include "server/service/service_context.h"

namespace clearance {

// Owns itself until the transport is done with it. At any time one thread works on the stream: the
// one that decides how it begins, then a worker or the transport's write.
class RegionStream final : public grpc::ServerWriteReactor<v1::GetRegionResponse>,
                           public std::enable_shared_from_this<RegionStream> {
 public:
  static grpc::ServerWriteReactor<v1::GetRegionResponse>* Start(
      ServiceContext* service, const v1::GetRegionRequest& request);
  ~RegionStream() override;

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  explicit RegionStream(ServiceContext* service);

  void Open(const v1::GetRegionRequest& request);
  void Begin(ViewPtr view, const wire::RegionQuery& query);
  void Fail(const absl::Status& status);  // before Begin
  void PostNext();
  void SendNext();
  void End(const absl::Status& status);

  ServiceContext* const service_;
  const std::chrono::steady_clock::time_point started_at_ = std::chrono::steady_clock::now();
  std::shared_ptr<RegionStream> self_;
  uint64_t open_id_ = 0;
  std::atomic<bool> decided_ = false;  // begun or ended
  std::atomic<bool> cancelled_ = false, draining_ = false;
  Mutex mu_;
  std::function<void()> cancel_wait_ ABSL_GUARDED_BY(mu_);
  std::optional<Region> region_;
  uint64_t next_ = 0;
  v1::GetRegionResponse block_;
};

}  // namespace clearance
