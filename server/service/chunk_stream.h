// A file as a server stream of checksummed chunks, produced later, sent in order.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "proto/wire/grpc_status.h"
#include "server/core/crc32c.h"
#include "server/service/service_context.h"

namespace clearance {

inline constexpr size_t kChunkBytes = 256 * 1024;

// The first of Send, Fail and the client's cancellation decides how the stream ends. Thread-safe.
template <typename Response>
class ChunkStream final : public grpc::ServerWriteReactor<Response>,
                          public std::enable_shared_from_this<ChunkStream<Response>> {
 public:
  // Owns itself until the transport is done with it.
  static std::shared_ptr<ChunkStream> Start(ServiceContext* service, const char* method) {
    std::shared_ptr<ChunkStream> stream(new ChunkStream(service, method));
    stream->self_ = stream;
    ++service->open_streams;
    return stream;
  }

  bool done() const { return decided_; }

  // Sends `data`; `header` goes into every chunk, `first` changes the first one. An empty file is
  // one chunk without data.
  void Send(std::string data, Response header, const std::function<void(Response*)>& first) {
    if (decided_.exchange(true)) return;
    data_ = std::move(data);
    header_ = std::move(header);
    Fill();
    if (first) first(&chunk_);
    this->StartWrite(&chunk_);
  }

  void Fail(const absl::Status& status) {
    if (decided_.exchange(true)) return;
    End(status);
  }

  void OnWriteDone(bool ok) override {
    if (!ok) return End(absl::CancelledError("the client is gone"));
    if (offset_ >= data_.size()) return End(absl::OkStatus());
    Fill();
    this->StartWrite(&chunk_);
  }
  void OnCancel() override { Fail(absl::CancelledError("the client cancelled")); }
  void OnDone() override {
    --service_->open_streams;
    self_.reset();
  }

 private:
  ChunkStream(ServiceContext* service, const char* method) : service_(service), method_(method) {}

  void Fill() {
    chunk_ = header_;
    const size_t size = std::min(kChunkBytes, data_.size() - offset_);
    chunk_.set_offset(offset_);
    chunk_.set_total_bytes(data_.size());
    chunk_.set_data(data_.data() + offset_, size);
    chunk_.set_crc32c(Crc32c(chunk_.data()));
    offset_ += size;
  }

  void End(const absl::Status& status) {
    const double ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - started_at_)
            .count();
    service_->calls.Record(method_, status.code(), ms);
    this->Finish(wire::ToGrpcStatus(status));
  }

  ServiceContext* const service_;
  const char* const method_;
  const std::chrono::steady_clock::time_point started_at_ = std::chrono::steady_clock::now();
  std::shared_ptr<ChunkStream> self_;
  std::atomic<bool> decided_ = false;
  // Touched by whoever decided, then by OnWriteDone.
  std::string data_;
  Response header_, chunk_;
  size_t offset_ = 0;
};

}  // namespace clearance
