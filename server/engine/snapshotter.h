// Writes snapshots, one after the other, on a thread of its own; asked for, or by the clock.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/engine/mapping_engine.h"
#include "server/engine/mutex.h"

namespace clearance {

inline constexpr char kLedgersFile[] = "ledgers.bin";

struct SnapshotOptions {
  std::chrono::milliseconds period{0};  // of automatic snapshots of maps that changed; 0 = none
  size_t keep = 3;                      // newest automatic ones; 0 = all
  size_t queue = 64;                    // that may wait
};

struct SnapshotterStats {
  uint64_t written = 0, failed = 0;
  double last_ms = 0;
  std::string last_error;
};

// Thread-safe. The mapping thread of a map copies the state; everything else happens here.
class Snapshotter {
 public:
  using Engines = std::function<std::vector<std::shared_ptr<MappingEngine>>()>;
  using Done = std::function<void(absl::StatusOr<SnapshotManifest>)>;

  Snapshotter(Engines engines, const SnapshotOptions& options);
  ~Snapshotter();  // finishes what it writes; what waits ends with UNAVAILABLE

  // An empty id is replaced by one that says when. `done` runs on this object's or the map's
  // thread, exactly once where OK is returned. FAILED_PRECONDITION for a map without a folder,
  // INVALID_ARGUMENT, ALREADY_EXISTS, RESOURCE_EXHAUSTED.
  absl::Status Create(const std::shared_ptr<MappingEngine>& engine, std::string snapshot_id,
                      std::string comment, bool automatic, Done done);
  void Stop();
  SnapshotterStats Stats() const;

 private:
  struct Job {
    std::shared_ptr<MappingEngine> engine;
    SnapshotManifest manifest;
    MappingEngine::Frozen frozen;
    Done done;
  };

  void Run();
  void Enqueue(Job job);
  void CreateDue();
  absl::StatusOr<SnapshotManifest> Write(Job& job);

  const Engines engines_;
  const SnapshotOptions options_;
  mutable Mutex mu_;
  CondVar changed_;
  std::deque<Job> jobs_ ABSL_GUARDED_BY(mu_);
  size_t pending_ ABSL_GUARDED_BY(mu_) = 0;  // jobs, and those whose map is still copying
  bool stopping_ ABSL_GUARDED_BY(mu_) = false;
  SnapshotterStats stats_ ABSL_GUARDED_BY(mu_);
  std::map<std::string, std::pair<uint64_t, uint64_t>> newest_;  // epoch and revision; own thread
  std::thread thread_;
};

// [a-z0-9][a-z0-9_-]{0,62}.
absl::Status ValidateSnapshotId(std::string_view id);

}  // namespace clearance
