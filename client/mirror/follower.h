// The thread that follows a map. Private to the mirror.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <random>
#include <thread>

#include "clearance/v1/watch.grpc.pb.h"
#include "client/mirror/mirror.h"
#include "client/mirror/view_builder.h"

namespace clearance::client {

class Mirror::Follower {
 public:
  explicit Follower(const MirrorOptions& options);
  ~Follower();

  ViewBuilder::ViewPtr View() const;
  MirrorStatus Status() const;
  absl::Status WaitFor(uint64_t revision, uint64_t epoch, absl::Duration timeout) const;

 private:
  using Clock = std::chrono::steady_clock;

  void Run();
  // One watch from its request to its end; sets `progress` where a message came.
  absl::Status Watch(bool* progress);
  absl::Status Take(const v1::WatchMapResponse& message);
  void Count(const v1::WatchMapResponse& message);
  void Pause(absl::Duration backoff);

  const MirrorOptions options_;
  // The thread's own.
  ViewBuilder builder_;
  bool from_checkpoint_ = false;  // what the builder holds cannot be resumed
  std::shared_ptr<grpc::Channel> channel_;
  std::mt19937 random_{std::random_device{}()};
  MirrorUpdate update_;

  mutable std::mutex mu_;  // guards what follows
  mutable std::condition_variable changed_;
  bool stopping_ = false;
  grpc::ClientContext* context_ = nullptr;  // of the running watch
  ViewBuilder::ViewPtr view_;
  MirrorStatus status_;
  Clock::time_point last_message_ = Clock::now();
  std::thread thread_;
};

}  // namespace clearance::client
