// The maps of one process, by id.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "server/engine/mapping_engine.h"

namespace clearance {

struct RegistryOptions {
  EngineOptions engine;
  size_t max_maps = 64;
  MapModelFactory model;  // required
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

  // Refuses new maps and frames and settles what waits. False where the deadline came first.
  bool Drain(std::chrono::steady_clock::time_point deadline);
  void StopAll();

  TimerQueue& timers() { return timers_; }

 private:
  absl::Status NotFound(std::string_view id) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mu_);

  const RegistryOptions options_;
  TimerQueue timers_;
  mutable Mutex mu_;
  bool draining_ ABSL_GUARDED_BY(mu_) = false;
  std::map<std::string, EnginePtr, std::less<>> maps_ ABSL_GUARDED_BY(mu_);
};

}  // namespace clearance
