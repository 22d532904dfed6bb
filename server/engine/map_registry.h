// The maps of one process, by id.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "server/engine/mapping_engine.h"
#include "server/engine/snapshotter.h"
#include "server/store/data_directory.h"

namespace clearance {

struct RegistryOptions {
  EngineOptions engine;
  size_t max_maps = 64;
  MapModelFactory model;  // required
  // Where maps are kept; null: nowhere. Outlives the registry. With it, `load` and engine.codec are
  // required, and until Recover() has run every call ends with UNAVAILABLE.
  DataDirectory* storage = nullptr;
  MapModelLoader load;
  SnapshotOptions snapshots;
};

inline constexpr char kDefaultMapId[] = "default";

// [a-z][a-z0-9_-]{0,62}. INVALID_ARGUMENT naming `field`, what was got and what is allowed.
absl::Status ValidateId(std::string_view id, std::string_view field);

// Thread-safe.
class MapRegistry {
 public:
  using EnginePtr = std::shared_ptr<MappingEngine>;

  explicit MapRegistry(RegistryOptions options);
  ~MapRegistry();  // stops all maps

  // INVALID_ARGUMENT for a bad id or config, ALREADY_EXISTS, RESOURCE_EXHAUSTED at max_maps,
  // UNAVAILABLE while draining. Each map gets an epoch of its own.
  absl::StatusOr<EnginePtr> Create(std::string_view id, const MapConfig& config);
  // Empty means `default`. NOT_FOUND naming the maps that exist.
  absl::StatusOr<EnginePtr> Get(std::string_view id) const;
  std::vector<EnginePtr> List() const;  // by id
  // Takes the map out at once and waits until its thread has ended. Readers that hold it finish.
  absl::StatusOr<EnginePtr> Delete(std::string_view id);

  // Brings back all maps that are on disk. `note` is told what had to be repaired or passed over.
  // DATA_LOSS or FAILED_PRECONDITION where a map cannot come back whole; nothing is served then.
  absl::Status Recover(const std::function<void(const std::string&)>& note);
  bool loading() const;

  // As Snapshotter::Create. NOT_FOUND.
  absl::Status CreateSnapshot(std::string_view id, std::string snapshot_id, std::string comment,
                              Snapshotter::Done done);
  // Reads and checks the whole snapshot, calls `before_swap`, then replaces the map by it: a new
  // epoch, and a new log behind the snapshot. NOT_FOUND, DATA_LOSS, FAILED_PRECONDITION; where it
  // fails the map stays as it was.
  absl::StatusOr<EnginePtr> RestoreSnapshot(std::string_view id, const std::string& snapshot_id,
                                            const std::function<void()>& before_swap);
  SnapshotterStats snapshot_stats() const;
  bool durable() const { return options_.storage != nullptr; }

  // Refuses new maps and frames and settles what waits. False where the deadline came first.
  bool Drain(std::chrono::steady_clock::time_point deadline);
  void StopAll();

  TimerQueue& timers() { return timers_; }

 private:
  absl::Status Unavailable() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);
  RecoveryOptions Recovery() const;
  absl::Status NotFound(std::string_view id) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);

  const RegistryOptions options_;
  TimerQueue timers_;
  Mutex change_mu_;  // one change of the set of maps at a time; taken before mu_
  mutable Mutex mu_;
  bool loading_ ABSL_GUARDED_BY(mu_) = false;
  bool draining_ ABSL_GUARDED_BY(mu_) = false;
  std::map<std::string, EnginePtr, std::less<>> maps_ ABSL_GUARDED_BY(mu_);
  // Maps that are being replaced.
  std::set<std::string, std::less<>> restoring_ ABSL_GUARDED_BY(mu_);
  std::unique_ptr<Snapshotter> snapshotter_;
};

}  // namespace clearance
