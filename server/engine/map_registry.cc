#include "server/engine/map_registry.h"

#include <algorithm>
#include <random>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace clearance {
namespace {

constexpr size_t kMaxIdLength = 63;

// Random, so that a restarted server never repeats one; 53 bits, so that every language's numbers
// hold it exactly.
uint64_t NewEpoch() {
  std::random_device random;
  const uint64_t bits = (uint64_t{random()} << 32) | random();
  return std::max<uint64_t>(1, bits >> 11);
}

}  // namespace

absl::Status ValidateId(std::string_view id, std::string_view field) {
  const bool good =
      !id.empty() && id.size() <= kMaxIdLength && absl::ascii_islower(id[0]) &&
      std::all_of(id.begin(), id.end(), [](unsigned char c) {
        return absl::ascii_islower(c) || absl::ascii_isdigit(c) || c == '_' || c == '-';
      });
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: got '%s', expected [a-z][a-z0-9_-]{0,62}", field, id.substr(0, 80)));
}

MapRegistry::MapRegistry(RegistryOptions options) : options_(std::move(options)) {}

MapRegistry::~MapRegistry() { StopAll(); }

absl::Status MapRegistry::NotFound(std::string_view id) const {
  const std::string existing = absl::StrJoin(
      maps_, ", ", [](std::string* out, const auto& entry) { out->append(entry.first); });
  return absl::NotFoundError(absl::StrFormat("map '%s' does not exist. Maps: %s", id.substr(0, 80),
                                             existing.empty() ? "none" : existing));
}

absl::StatusOr<MapRegistry::EnginePtr> MapRegistry::Create(std::string_view id,
                                                           const MapConfig& config) {
  if (id.empty()) id = kDefaultMapId;
  if (absl::Status status = ValidateId(id, "map"); !status.ok()) return status;
  if (absl::Status status = config.Validate(); !status.ok()) return status;
  MutexLock lock(&mu_);
  if (draining_) return absl::UnavailableError("the server is draining; connect again");
  if (maps_.contains(id)) {
    return absl::AlreadyExistsError(absl::StrFormat("map '%s' exists already", id));
  }
  if (maps_.size() >= options_.max_maps) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("map '%s' would be number %d, limit %d; delete one first", id,
                        maps_.size() + 1, options_.max_maps));
  }
  auto engine = std::make_shared<MappingEngine>(std::string(id), config, options_.model(config),
                                                NewEpoch(), &timers_, options_.engine);
  maps_.emplace(id, engine);
  return engine;
}

absl::StatusOr<MapRegistry::EnginePtr> MapRegistry::Get(std::string_view id) const {
  if (id.empty()) id = kDefaultMapId;
  if (absl::Status status = ValidateId(id, "map"); !status.ok()) return status;
  MutexLock lock(&mu_);
  const auto it = maps_.find(id);
  if (it == maps_.end()) return NotFound(id);
  return it->second;
}

std::vector<MapRegistry::EnginePtr> MapRegistry::List() const {
  MutexLock lock(&mu_);
  std::vector<EnginePtr> engines;
  for (const auto& [id, engine] : maps_) engines.push_back(engine);
  return engines;
}

absl::StatusOr<MapRegistry::EnginePtr> MapRegistry::Delete(std::string_view id) {
  if (id.empty()) id = kDefaultMapId;
  if (absl::Status status = ValidateId(id, "map"); !status.ok()) return status;
  EnginePtr engine;
  {
    MutexLock lock(&mu_);
    const auto it = maps_.find(id);
    if (it == maps_.end()) return NotFound(id);
    engine = std::move(it->second);
    maps_.erase(it);
  }
  engine->Stop();
  return engine;
}

bool MapRegistry::Drain(std::chrono::steady_clock::time_point deadline) {
  {
    MutexLock lock(&mu_);
    draining_ = true;
  }
  bool drained = true;
  for (const EnginePtr& engine : List()) drained &= engine->Drain(deadline);
  return drained;
}

void MapRegistry::StopAll() {
  {
    MutexLock lock(&mu_);
    draining_ = true;
  }
  for (const EnginePtr& engine : List()) engine->Stop();
}

}  // namespace clearance
