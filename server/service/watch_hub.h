// All watchers of all maps: one thread that tells each what it lacks.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <thread>
#include <vector>

#include "server/engine/change_log.h"
#include "server/engine/mutex.h"
#include "server/service/service_context.h"
#include "server/service/watch_stream.h"

namespace clearance {

inline constexpr size_t kMaxWatchers = 256;

// A watcher has a revision and at most one message in flight. Whatever is published meanwhile is
// told at once when that message is out, as one delta, so a slow reader costs no queue. The thread
// tells one part at a time, so a large checkpoint holds nobody up. Thread-safe.
class WatchHub {
 public:
  explicit WatchHub(ServiceContext* service);
  ~WatchHub();  // after the transport has let go of all streams

  // A stream that is told what it asks for, or that ends at once: INVALID_ARGUMENT, UNAVAILABLE
  // while draining, RESOURCE_EXHAUSTED beyond kMaxWatchers. It owns itself.
  WatchStream* Start(const v1::WatchMapRequest& request);

 private:
  using StreamPtr = std::shared_ptr<WatchStream>;
  using Clock = std::chrono::steady_clock;

  // What other threads have to say. Shared, because they may speak after the hub is gone.
  struct Inbox {
    Mutex mu;
    CondVar changed;
    std::vector<StreamPtr> ready ABSL_GUARDED_BY(mu);
    std::map<uint64_t, bool> published ABSL_GUARDED_BY(mu);  // map watches; whether they are over
    bool stop ABSL_GUARDED_BY(mu) = false;

    void Ready(StreamPtr stream);
    void Published(uint64_t map_watch, bool over);
  };

  // One epoch of a map that somebody watches or has watched.
  struct MapWatch {
    MapRegistry::EnginePtr engine;
    ChangeLog log;
    uint64_t wait = 0;  // for the next view
    bool over = false;  // the map has stopped
    std::set<StreamPtr> streams;
    // The delta from log.previous() to the newest, made once for all who stand there.
    std::vector<WatchStream::Message> step;
  };

  void Run();
  void OnPublished(uint64_t id, bool over);
  void Await(uint64_t id, MapWatch* watch);
  // Moves the stream on by at most one message.
  void Serve(const StreamPtr& stream);
  bool WritePart(const StreamPtr& stream);  // of what is being told; false where all is told
  void Bind(const StreamPtr& stream);       // to its map: hello, or the end, or wait for it
  void BeginDelta(const StreamPtr& stream, MapWatch* watch);
  void OnClosed(const StreamPtr& stream, uint64_t id);
  void End(const StreamPtr& stream, const absl::Status& status);
  void Leave(const StreamPtr& stream);
  void Wake(const StreamPtr& stream, Clock::time_point when);
  uint64_t WatchOf(const MapRegistry::EnginePtr& engine, const WatchRequest& request);

  ServiceContext* const service_;
  const std::shared_ptr<Inbox> inbox_ = std::make_shared<Inbox>();
  std::atomic<size_t> watchers_ = 0;
  // The hub's thread only.
  std::map<uint64_t, MapWatch> maps_;
  uint64_t next_map_ = 1;
  std::thread thread_;
};

}  // namespace clearance
