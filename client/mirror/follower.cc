#include "client/mirror/follower.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/channel.h"
#include "client/convert.h"
#include "client/mirror/answers.h"
#include "proto/wire/geometry.h"

namespace clearance::client {
namespace {

// So that stopping does not wait for a server that is not there.
constexpr absl::Duration kConnectAttempt = absl::Milliseconds(500);

ViewLimits LimitsOf(const MirrorOptions& options) {
  ViewLimits limits;
  limits.max_memory_bytes = options.memory_limit_bytes;
  return limits;
}

// What the builder finds wrong; the connection itself is fine then.
bool IsContentError(const absl::Status& status) {
  return absl::IsDataLoss(status) || absl::IsFailedPrecondition(status) ||
         absl::IsInvalidArgument(status) || absl::IsResourceExhausted(status);
}

}  // namespace

Mirror::Follower::Follower(const MirrorOptions& options)
    : options_(options), builder_(LimitsOf(options)) {
  if (options_.stale_after_s > 0) builder_.set_stale_after_s(options_.stale_after_s);
  status_.last_error = absl::UnavailableError("connecting");
  thread_ = std::thread([this] { Run(); });
}

Mirror::Follower::~Follower() {
  {
    std::lock_guard lock(mu_);
    stopping_ = true;
    if (context_ != nullptr) context_->TryCancel();
    changed_.notify_all();
  }
  thread_.join();
}

ViewBuilder::ViewPtr Mirror::Follower::View() const {
  std::lock_guard lock(mu_);
  return view_;
}

MirrorStatus Mirror::Follower::Status() const {
  std::lock_guard lock(mu_);
  MirrorStatus status = status_;
  const auto now = Clock::now();
  status.silence_s = std::chrono::duration<double>(now - last_message_).count();
  status.ready = view_ != nullptr;
  if (view_ == nullptr) return status;
  status.stamp = MapStampOf(*view_);
  status.age_s = status.stamp.staleness_s;
  status.stale = status.age_s > view_->config.stale_after_s;
  return status;
}

absl::Status Mirror::Follower::WaitFor(uint64_t revision, uint64_t epoch,
                                       absl::Duration timeout) const {
  const auto reached = [&] {
    return view_ != nullptr && (epoch == 0 || view_->epoch == epoch) &&
           view_->field_revision >= revision;
  };
  std::unique_lock lock(mu_);
  const auto deadline = Clock::now() + absl::ToChronoMicroseconds(timeout);
  if (changed_.wait_until(lock, deadline, reached)) return absl::OkStatus();
  return absl::DeadlineExceededError(absl::StrFormat(
      "the mirror did not reach revision %d within %s; it is at %s; %s", revision,
      absl::FormatDuration(timeout),
      view_ == nullptr
          ? "nothing yet"
          : absl::StrFormat("revision %d of epoch %d", view_->field_revision, view_->epoch),
      status_.connected ? "connected" : std::string(status_.last_error.message())));
}

void Mirror::Follower::Run() {
  absl::Duration backoff = options_.first_backoff;
  while (true) {
    {
      std::lock_guard lock(mu_);
      if (stopping_) return;
    }
    bool progress = false;
    const absl::Status status = Watch(&progress);
    builder_.Interrupt();
    // Resuming content that was wrong would only be wrong again.
    from_checkpoint_ = IsContentError(status);
    {
      std::lock_guard lock(mu_);
      status_.connected = false;
      status_.last_error = status;
    }
    if (progress && !from_checkpoint_) backoff = options_.first_backoff;
    Pause(backoff);
    backoff = std::min(backoff * 2, options_.max_backoff);
  }
}

void Mirror::Follower::Pause(absl::Duration backoff) {
  // Mirrors that lost the same server do not come back in step.
  const double jitter = std::uniform_real_distribution<double>(0.7, 1.3)(random_);
  std::unique_lock lock(mu_);
  changed_.wait_for(lock, absl::ToChronoMicroseconds(backoff * jitter),
                    [this] { return stopping_; });
}

absl::Status Mirror::Follower::Watch(bool* progress) {
  if (channel_ == nullptr) {
    auto channel = OpenChannel(options_.client.address, options_.client.credentials,
                               std::min(options_.client.connect_timeout, kConnectAttempt));
    if (!channel.ok()) return channel.status();
    channel_ = *std::move(channel);
  }
  v1::WatchMapRequest request;
  request.set_map(options_.client.map);
  if (builder_.current() && !from_checkpoint_) {
    request.set_epoch(builder_.current()->epoch);
    request.set_revision(builder_.current()->revision);
  }
  if (options_.bounds) wire::ToProto(*options_.bounds, request.mutable_bounds());
  request.set_max_rate_hz(options_.max_rate_hz);
  request.set_poses_only(options_.poses_only);

  grpc::ClientContext context;
  {
    std::lock_guard lock(mu_);
    if (stopping_) return absl::CancelledError("stopped");
    context_ = &context;
  }
  const auto stub = v1::WatchService::NewStub(channel_);
  const auto reader = stub->WatchMap(&context, request);
  v1::WatchMapResponse message;
  absl::Status broken;
  while (broken.ok() && reader->Read(&message)) {
    *progress = true;
    broken = Take(message);
  }
  if (!broken.ok()) context.TryCancel();
  while (reader->Read(&message)) continue;
  const absl::Status status = CallStatus(reader->Finish(), options_.client.address);
  {
    std::lock_guard lock(mu_);
    context_ = nullptr;
  }
  if (!broken.ok()) return broken;
  return status.ok() ? absl::UnavailableError("the server ended the watch") : status;
}

absl::Status Mirror::Follower::Take(const v1::WatchMapResponse& message) {
  const auto started = Clock::now();
  Count(message);
  const absl::StatusOr<ViewBuilder::ViewPtr> view = builder_.Take(message);
  if (!view.ok()) return view.status();
  update_.apply_ms += std::chrono::duration<double, std::milli>(Clock::now() - started).count();
  if (*view == nullptr) return absl::OkStatus();
  {
    std::lock_guard lock(mu_);
    view_ = *view;
    ++(update_.checkpoint ? status_.checkpoints : status_.deltas);
    changed_.notify_all();
  }
  update_.stamp = MapStampOf(**view);
  if (options_.on_update) options_.on_update(update_);
  update_ = {};
  return absl::OkStatus();
}

void Mirror::Follower::Count(const v1::WatchMapResponse& message) {
  const uint64_t bytes = message.ByteSizeLong();
  uint64_t block_bytes = 0, object_bytes = 0, surface_bytes = 0, blocks = 0;
  const auto count = [&](const auto& part) {
    for (const v1::FieldBlocks& b : part.blocks()) {
      block_bytes += b.ByteSizeLong();
      blocks += (b.indices_i32().size() + b.removed_i32().size()) / 12;
    }
    for (const v1::ObjectState& object : part.objects()) {
      object_bytes += object.ByteSizeLong();
      surface_bytes += object.surface().payload().size();
    }
  };
  if (message.has_checkpoint()) count(message.checkpoint());
  if (message.has_delta()) count(message.delta());
  update_.bytes += bytes;
  update_.checkpoint = message.has_checkpoint();
  update_.prev_revision = message.delta().prev_revision();
  std::lock_guard lock(mu_);
  last_message_ = Clock::now();
  status_.bytes += bytes;
  status_.block_bytes += block_bytes;
  status_.object_bytes += object_bytes;
  status_.surface_bytes += surface_bytes;
  status_.blocks += blocks;
  if (!message.has_hello()) return;
  status_.connected = true;
  status_.last_error = absl::OkStatus();
  ++status_.connects;
  if (message.hello().resumes()) ++status_.resumes;
}

}  // namespace clearance::client
