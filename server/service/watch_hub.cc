#include "server/service/watch_hub.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/status_details.h"
#include "server/service/resolve.h"

namespace clearance {
namespace {

constexpr std::chrono::hours kAwait{1};  // then again
constexpr std::chrono::milliseconds kNextEpochPoll{50};
constexpr std::chrono::seconds kNextEpochPatience{10};

}  // namespace

void WatchHub::Inbox::Ready(StreamPtr stream) {
  MutexLock lock(&mu);
  if (stop) return;
  ready.push_back(std::move(stream));
  changed.NotifyOne();
}

void WatchHub::Inbox::Published(uint64_t map_watch, bool over) {
  MutexLock lock(&mu);
  published[map_watch] |= over;
  changed.NotifyOne();
}

WatchHub::WatchHub(ServiceContext* service) : service_(service), thread_([this] { Run(); }) {}

WatchHub::~WatchHub() {
  {
    MutexLock lock(&inbox_->mu);
    inbox_->stop = true;
    inbox_->ready.clear();
    inbox_->changed.NotifyOne();
  }
  thread_.join();
  for (auto& [id, watch] : maps_) watch.engine->store().CancelWait(watch.wait);
}

WatchStream* WatchHub::Start(const v1::WatchMapRequest& request) {
  absl::StatusOr<WatchRequest> decoded = WatchRequestFromProto(request);
  if (service_->draining) decoded = DrainingError();
  if (decoded.ok() && watchers_ >= kMaxWatchers) {
    decoded = wire::WithRetry(absl::ResourceExhaustedError(absl::StrFormat(
                                  "%d watchers are connected, limit %d; try again later",
                                  watchers_.load(), kMaxWatchers)),
                              absl::Seconds(5));
  }
  if (!decoded.ok()) {
    const StreamPtr refused = WatchStream::Start(service_, {}, [](const StreamPtr&) {});
    refused->End(decoded.status());
    return refused.get();
  }
  ++watchers_;
  const StreamPtr stream =
      WatchStream::Start(service_, *std::move(decoded),
                         [inbox = inbox_](StreamPtr ready) { inbox->Ready(std::move(ready)); });
  inbox_->Ready(stream);
  return stream.get();
}

void WatchHub::Run() {
  while (true) {
    std::vector<StreamPtr> ready;
    std::map<uint64_t, bool> published;
    {
      MutexLock lock(&inbox_->mu);
      while (!inbox_->stop && inbox_->ready.empty() && inbox_->published.empty()) {
        inbox_->changed.Wait(&inbox_->mu);
      }
      if (inbox_->stop) return;
      ready.swap(inbox_->ready);
      published.swap(inbox_->published);
    }
    for (const auto& [id, over] : published) OnPublished(id, over);
    for (const StreamPtr& stream : ready) Serve(stream);
  }
}

// The next view of the map, or its end, comes into the inbox.
void WatchHub::Await(uint64_t id, MapWatch* watch) {
  watch->wait = watch->engine->store().WhenFieldRevision(
      watch->log.newest()->field_revision + 1, Clock::now() + kAwait,
      [inbox = inbox_, id](const absl::StatusOr<ViewPtr>& view) {
        inbox->Published(id, !view.ok() && !absl::IsAborted(view.status()));
      });
}

void WatchHub::OnPublished(uint64_t id, bool over) {
  const auto it = maps_.find(id);
  if (it == maps_.end()) return;
  MapWatch& watch = it->second;
  const uint64_t known = watch.log.newest()->revision;
  watch.log.Advance(watch.engine->Latest());
  if (watch.log.newest()->revision != known) watch.step.clear();
  watch.over = over;
  if (!over) Await(id, &watch);
  const std::set<StreamPtr> streams = watch.streams;  // Serve may change it
  for (const StreamPtr& stream : streams) Serve(stream);
  const auto after = maps_.find(id);
  if (after != maps_.end() && over && after->second.streams.empty()) maps_.erase(after);
}

void WatchHub::Serve(const StreamPtr& stream) {
  if (stream->finished() || stream->writing()) return;
  if (stream->gone()) return End(stream, absl::CancelledError("the client is gone"));
  if (WritePart(stream)) return;
  if (stream->map_watch == 0) return Bind(stream);
  MapWatch& watch = maps_.at(stream->map_watch);
  if (!stream->revision) {
    stream->telling = WatchMessages::Checkpoint(watch.log.newest(), stream->request().selection);
    stream->telling_revision = watch.log.newest()->revision;
    WritePart(stream);
    return;
  }
  if (*stream->revision < watch.log.newest()->revision) {
    const Clock::time_point now = Clock::now();
    if (now < stream->next_delta_at) return Wake(stream, stream->next_delta_at);
    if (stream->request().max_rate_hz > 0) {
      stream->next_delta_at =
          now + std::chrono::duration_cast<Clock::duration>(
                    std::chrono::duration<double>(1 / stream->request().max_rate_hz));
    }
    BeginDelta(stream, &watch);
    WritePart(stream);
    return;
  }
  if (watch.over) OnClosed(stream, stream->map_watch);
}

bool WatchHub::WritePart(const StreamPtr& stream) {
  if (stream->telling) {
    auto message = std::make_shared<v1::WatchMapResponse>();
    if (stream->telling->Next(message.get())) {
      stream->Write(std::move(message));
      return true;
    }
    stream->telling.reset();
    stream->revision = stream->telling_revision;
  }
  if (stream->next_shared < stream->shared.size()) {
    stream->Write(stream->shared[stream->next_shared++]);
    return true;
  }
  if (!stream->shared.empty()) {
    stream->shared.clear();
    stream->next_shared = 0;
    stream->revision = stream->telling_revision;
  }
  return false;
}

void WatchHub::BeginDelta(const StreamPtr& stream, MapWatch* watch) {
  const ChangeLog& log = watch->log;
  stream->telling_revision = log.newest()->revision;
  const bool one_step = log.previous() && log.previous()->revision == *stream->revision;
  if (!one_step || !stream->request().selection.everything()) {
    stream->telling = WatchMessages::Delta(log, *stream->revision, stream->request().selection);
    return;
  }
  if (watch->step.empty()) {
    WatchMessages messages = WatchMessages::Delta(log, *stream->revision, {});
    while (true) {
      auto message = std::make_shared<v1::WatchMapResponse>();
      if (!messages.Next(message.get())) break;
      watch->step.push_back(std::move(message));
    }
  }
  stream->shared = watch->step;
  stream->next_shared = 0;
}

void WatchHub::Bind(const StreamPtr& stream) {
  if (service_->draining) return End(stream, DrainingError());
  const WatchRequest& request = stream->request();
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Get(request.map);
  if (!engine.ok()) return End(stream, engine.status());
  const Clock::time_point now = Clock::now();
  const uint64_t id = WatchOf(*engine, request);
  if (maps_.at(id).over) {  // its successor is on the way, or its end
    if (stream->waiting_since == Clock::time_point{}) stream->waiting_since = now;
    if (now - stream->waiting_since > kNextEpochPatience) {
      End(stream, DrainingError());
    } else {
      Wake(stream, now + kNextEpochPoll);
    }
    return;
  }
  stream->waiting_since = {};
  stream->map_watch = id;
  MapWatch& watch = maps_.at(stream->map_watch);
  watch.streams.insert(stream);
  const bool resumes =
      request.epoch == (*engine)->epoch() && watch.log.Since(request.revision).has_value();
  stream->revision = resumes ? std::optional(request.revision) : std::nullopt;
  auto message = std::make_shared<v1::WatchMapResponse>();
  FillHello(**engine, resumes, message->mutable_hello());
  ToProto(StampOf(*watch.log.newest()), message->mutable_stamp());
  stream->Write(std::move(message));
}

uint64_t WatchHub::WatchOf(const MapRegistry::EnginePtr& engine, const WatchRequest& request) {
  for (const auto& [id, watch] : maps_) {
    if (watch.engine == engine) return id;
  }
  const uint64_t id = next_map_++;
  // Somebody who comes back soon after a pause may find the view that it knows.
  const absl::StatusOr<ViewPtr> known = engine->store().Find(request.revision);
  MapWatch watch{engine, ChangeLog(known.ok() ? *known : engine->Latest()), 0, false, {}, {}};
  watch.log.Advance(engine->Latest());
  Await(id, &watch);
  maps_.emplace(id, std::move(watch));
  return id;
}

void WatchHub::OnClosed(const StreamPtr& stream, uint64_t id) {
  const std::string map = maps_.at(id).engine->id();
  Leave(stream);
  if (service_->draining) return End(stream, DrainingError());
  const absl::StatusOr<MapRegistry::EnginePtr> engine = service_->registry->Get(map);
  if (!engine.ok()) {
    return End(stream, absl::NotFoundError(absl::StrFormat(
                           "map '%s' was deleted; watch again once it exists", map)));
  }
  Bind(stream);
}

void WatchHub::End(const StreamPtr& stream, const absl::Status& status) {
  Leave(stream);
  --watchers_;
  stream->End(status);
}

void WatchHub::Leave(const StreamPtr& stream) {
  const auto it = maps_.find(stream->map_watch);
  stream->map_watch = 0;
  stream->revision.reset();
  if (it == maps_.end()) return;
  it->second.streams.erase(stream);
  if (it->second.over && it->second.streams.empty()) maps_.erase(it);
}

void WatchHub::Wake(const StreamPtr& stream, Clock::time_point when) {
  if (stream->wake_at > Clock::now() && stream->wake_at <= when) return;
  stream->wake_at = when;
  service_->registry->timers().Schedule(when, [inbox = inbox_, weak = std::weak_ptr(stream)] {
    if (StreamPtr alive = weak.lock()) inbox->Ready(std::move(alive));
  });
}

}  // namespace clearance
