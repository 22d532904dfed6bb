// One map at work: a bounded queue in, one mapping thread, published views out.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "server/core/frame.h"
#include "server/engine/frame_ack.h"
#include "server/engine/frame_queue.h"
#include "server/engine/latency.h"
#include "server/engine/log_record.h"
#include "server/engine/map_model.h"
#include "server/engine/map_store.h"
#include "server/engine/mutex.h"
#include "server/engine/recovery.h"
#include "server/engine/source_ledger.h"
#include "server/store/map_folder.h"

namespace clearance {

struct EngineOptions {
  size_t queue_frames = 8;
  size_t queue_stripped_frames = 1024;
  size_t queue_tasks = 64;  // edits and exports that wait
  size_t kept_revisions = 8;
  size_t settled_window = 4096;
  std::chrono::milliseconds sizes_period{1000};
  FrameCodec codec;  // of what a log holds; needed with a folder
  // Above its own cap (MapConfig) or where the process is above this one (0 = none), a map takes no
  // frames, or, where it may, forgets what is farthest from the newest sensor pose.
  uint64_t process_memory_cap_bytes = 0;
  bool evict_over_cap = false;
  std::function<uint64_t()> process_memory_bytes;  // unset: the resident memory
  // Runs on the mapping thread before each frame is integrated: for tests that hold one.
  std::function<void(const Frame&)> before_integrate;
};

struct SourceStatus {
  std::string source_id;
  std::optional<uint64_t> last_frame_id;  // newest settled
  int64_t last_stamp_ns = 0;
  uint64_t integrated = 0, dropped = 0, rejected = 0, duplicate = 0;
};

struct EngineStats {
  size_t queue_length = 0, queue_capacity = 0;
  MapSizes sizes;
  std::vector<SourceStatus> sources;  // by id
  std::vector<std::pair<std::string, LatencySummary>> stages;
  std::string over_memory;  // the cap that refuses frames; empty: none
  uint64_t evictions = 0;
  std::optional<LogStats> log;
};

// kOverMemory: a memory cap is reached; nothing is taken until there is room again.
enum class Admission { kTaken, kFull, kStopped, kOverMemory };

// Thread-safe. Nothing here waits for an integration except Stop and Drain. Whoever owns an engine
// calls Stop before the last reference can go on the engine's own thread (MapRegistry does).
class MappingEngine {
 public:
  // Starts the mapping thread. `timers` outlives the engine.
  MappingEngine(std::string id, const MapConfig& config, std::unique_ptr<MapModel> model,
                uint64_t epoch, TimerQueue* timers, EngineOptions options = {});
  // Goes on from a state. With a folder, every frame is in its log before it is ACCEPTED and
  // integrated; a frame that cannot be logged is REJECTED.
  MappingEngine(std::string id, MapState start, std::shared_ptr<MapFolder> folder, uint64_t epoch,
                TimerQueue* timers, EngineOptions options = {});
  ~MappingEngine();  // stops; waiting frames are abandoned

  const std::string& id() const { return id_; }
  const MapConfig& config() const { return config_; }
  uint64_t epoch() const { return epoch_; }
  // Null: nothing of this map is on disk.
  const std::shared_ptr<MapFolder>& folder() const { return folder_; }
  MapStore& store() { return *store_; }
  ViewPtr Latest() const { return store_->Latest(); }

  // Takes a frame of frame.source_id. Where taken, `done` gets exactly one ack that settles it or
  // one kAbandoned, perhaps after one kAccepted; repeats of settled frames are acked at once. Where
  // not taken, `frame` is untouched and `done` never runs. `encoded`: the frame as the log takes it
  // (EngineOptions::codec); needed with a folder.
  Admission Submit(Frame&& frame, FrameCallback done, std::string* encoded = nullptr);
  // A frame that could not even be decoded: takes its turn and settles as REJECTED.
  Admission SubmitRejected(const std::string& source_id, uint64_t frame_id,
                           std::vector<Violation> violations, FrameCallback done);
  // Runs `room` once, as soon as the queue has room again (perhaps at once), or the engine stops.
  void NotifyRoom(std::function<void()> room);

  std::optional<uint64_t> LastSettledId(const std::string& source_id) const;
  EngineStats Stats() const;

  // Runs `task` on the mapping thread between two frames, with the view of that moment.
  // RESOURCE_EXHAUSTED when too many wait, UNAVAILABLE when stopped; `task` then never runs. A task
  // that still waits when the engine stops runs with nullptr arguments.
  using Task = std::function<void(MapModel* model, const ViewPtr& view)>;
  absl::Status Post(Task task);
  // Applies a region edit between two frames and publishes it.
  using EditCallback = std::function<void(absl::StatusOr<MapModel::Edited>, const RevisionStamp&)>;
  absl::Status EditRegion(const RegionEdit& edit, EditCallback done);

  // The whole state between two frames, for a snapshot. Errors as of Post.
  struct Frozen {
    std::unique_ptr<FrozenModel> model;
    std::string ledgers;
    RevisionStamp stamp;
    uint64_t lineage = 0, log_index = 0;
  };
  absl::Status Freeze(std::function<void(absl::StatusOr<Frozen>)> done);

  // Refuses new frames and waits until all waiting ones are settled. False at the deadline.
  bool Drain(std::chrono::steady_clock::time_point deadline);
  // After Stop: the state with which another engine goes on. Once.
  MapState TakeState();
  // Ends the thread after the frame at hand; what waits is abandoned. Idempotent.
  void Stop();

 private:
  using Clock = std::chrono::steady_clock;

  void Run();
  void RunFrame(QueuedFrame item);
  Admission Enqueue(QueuedFrame item, SourceLedger& ledger) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);
  SourceLedger& LedgerOf(const std::string& source_id) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);
  void Settle(const QueuedFrame& item, FrameAck ack);
  absl::Status AppendToLog(const LogRecord& record, std::string_view body = {});
  absl::Status LogFrame(const QueuedFrame& item);
  void LogRejected(const QueuedFrame& item);
  void RelieveMemory();
  void RecordStages(const StageTimes& stages);
  ViewPtr Publish(bool new_frame);
  void RefreshSizes(bool force);
  void AbandonAll();

  const std::string id_;
  const MapConfig config_;
  const uint64_t epoch_;
  const EngineOptions options_;
  const std::shared_ptr<MapFolder> folder_;
  const std::shared_ptr<FrameLog> log_;
  std::unique_ptr<MapModel> model_;  // mapping thread only
  uint64_t log_index_ = 0;           // mapping thread only
  // Rejections that found no room in the log; they go first once there is. Mapping thread only.
  std::deque<LogRecord> unlogged_;
  Clock::time_point sizes_at_;  // mapping thread only
  bool observed_ = false;  // the newest sizes have a box; mapping thread only
  std::shared_ptr<MapStore> store_;

  mutable Mutex mu_;
  CondVar changed_;
  FrameQueue queue_ ABSL_GUARDED_BY(mu_);
  std::vector<Task> tasks_ ABSL_GUARDED_BY(mu_);
  std::vector<std::function<void()>> room_ ABSL_GUARDED_BY(mu_);
  std::map<std::string, SourceLedger> ledgers_ ABSL_GUARDED_BY(mu_);
  std::map<std::string, LatencyHistogram> stages_ ABSL_GUARDED_BY(mu_);
  MapSizes sizes_ ABSL_GUARDED_BY(mu_);
  std::string over_memory_ ABSL_GUARDED_BY(mu_);  // which cap is reached; empty: none
  uint64_t evictions_ ABSL_GUARDED_BY(mu_) = 0;
  bool busy_ ABSL_GUARDED_BY(mu_) = false;
  bool draining_ ABSL_GUARDED_BY(mu_) = false;
  bool stopping_ ABSL_GUARDED_BY(mu_) = false;
  Mutex join_mu_;
  std::thread thread_ ABSL_GUARDED_BY(join_mu_);
};

}  // namespace clearance
