#include "planner_demo/episode/map_link.h"

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"

namespace clearance::demo {

using client::AckStatus;

absl::StatusOr<std::unique_ptr<MapLink>> MapLink::Open(const client::EsdfClient& client,
                                                       const std::string& map,
                                                       const wire::MapSettings& settings,
                                                       double max_range_m, Source source) {
  client.DeleteMap(map).IgnoreError();
  const auto created = client.CreateMap(map, settings);
  if (!created.ok()) return created.status();
  std::unique_ptr<MapLink> link(new MapLink(client, map));
  client::IngestOptions options;
  options.map = map;
  options.source_id = "robot";
  options.max_range_m = max_range_m;
  options.reconnect_for = absl::Seconds(1);
  options.on_ack = [link = link.get()](const client::FrameAck& ack) {
    if (ack.status == AckStatus::kAccepted) return;
    {
      const std::lock_guard<std::mutex> lock(link->mutex_);
      link->newest_ = ack;
    }
    link->acked_.notify_all();
  };
  auto stream = client.OpenIngest(options);
  if (!stream.ok()) return stream.status();
  link->stream_ = *std::move(stream);
  if (source == Source::kMirror) {
    client::MirrorOptions mirror_options;
    mirror_options.client = client.options();
    mirror_options.client.map = map;
    auto mirror = client::Mirror::Start(mirror_options);
    if (!mirror.ok()) return mirror.status();
    link->mirror_ = *std::move(mirror);
    const absl::Status ready = link->mirror_->WaitUntilReady(absl::Seconds(30));
    if (!ready.ok()) return ready;
  } else {
    client::QueryOptions query;
    query.map = map;
    link->remote_ = client::MakeRemoteDistanceSource(client, query);
  }
  return link;
}

MapLink::~MapLink() {
  mirror_.reset();
  if (stream_ != nullptr) stream_->Finish().IgnoreError();
  stream_.reset();
  client_.DeleteMap(map_).IgnoreError();
}

absl::Status MapLink::Integrate(const Frame& frame, absl::Duration patience) {
  const absl::Status sent = stream_->Send(frame);
  if (!sent.ok()) return sent;
  std::unique_lock<std::mutex> lock(mutex_);
  const bool settled = acked_.wait_for(lock, absl::ToChronoMilliseconds(patience), [&] {
    return newest_.frame_id >= frame.frame_id && newest_.status != AckStatus::kUnspecified;
  });
  if (!settled) {
    return absl::DeadlineExceededError(
        absl::StrCat("frame ", frame.frame_id, " is not integrated yet"));
  }
  if (newest_.status == AckStatus::kRejected) {
    return absl::FailedPreconditionError(absl::StrCat(
        "frame ", frame.frame_id,
        " was refused: ", newest_.violations.empty() ? "" : newest_.violations[0].description));
  }
  const uint64_t revision = newest_.stamp.revision;
  const uint64_t epoch = newest_.stamp.epoch;
  lock.unlock();
  return mirror_ == nullptr ? absl::OkStatus()
                            : mirror_->WaitForRevision(revision, patience, epoch);
}

double MapLink::map_time_s() const {
  if (mirror_ != nullptr) return 1e-9 * static_cast<double>(mirror_->Status().stamp.stamp_ns);
  const std::lock_guard<std::mutex> lock(mutex_);
  return 1e-9 * static_cast<double>(newest_.stamp.stamp_ns);
}

double MapLink::integrate_ms() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return newest_.integrate_ms;
}

Lookup MapLink::lookup() const {
  const client::DistanceSource* source = remote_.get();
  if (mirror_ != nullptr) source = mirror_.get();
  return [source](const Eigen::Matrix3Xd& points_W, const std::vector<float>& horizons_s) {
    return source->Distances(points_W, horizons_s);
  };
}

}  // namespace clearance::demo
