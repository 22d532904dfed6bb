#include "server/engine/map_registry.h"

#include <algorithm>
#include <random>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/map/map_config_code.h"

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

MapRegistry::MapRegistry(RegistryOptions options)
    : options_(std::move(options)), loading_(options_.storage != nullptr) {
  if (!options_.storage) return;
  snapshotter_ = std::make_unique<Snapshotter>([this] { return List(); }, options_.snapshots);
}

MapRegistry::~MapRegistry() { StopAll(); }

bool MapRegistry::loading() const {
  MutexLock lock(&mu_);
  return loading_;
}

absl::Status MapRegistry::Unavailable() const {
  if (loading_) return absl::UnavailableError("the server is loading its maps; try again");
  if (draining_) return absl::UnavailableError("the server is draining; connect again");
  return absl::OkStatus();
}

RecoveryOptions MapRegistry::Recovery() const {
  return {options_.model, options_.load, options_.engine.codec, options_.engine.settled_window};
}

absl::Status MapRegistry::Recover(const std::function<void(const std::string&)>& note) {
  if (!options_.storage) return absl::OkStatus();
  MutexLock change(&change_mu_);
  const absl::StatusOr<std::vector<std::string>> ids = options_.storage->Maps();
  if (!ids.ok()) return ids.status();
  std::map<std::string, EnginePtr, std::less<>> recovered;
  for (const std::string& id : *ids) {
    absl::StatusOr<std::unique_ptr<MapFolder>> folder = options_.storage->OpenMap(id);
    if (!folder.ok()) return folder.status();
    std::vector<std::string> notes;
    absl::StatusOr<MapState> state = RecoverMap(**folder, Recovery(), &notes);
    for (const std::string& text : notes) note(text);
    if (!state.ok()) return state.status();
    recovered.emplace(id, std::make_shared<MappingEngine>(id, *std::move(state), *std::move(folder),
                                                          NewEpoch(), &timers_, options_.engine));
  }
  MutexLock lock(&mu_);
  maps_ = std::move(recovered);
  loading_ = false;
  return absl::OkStatus();
}

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
  MutexLock change(&change_mu_);
  {
    MutexLock lock(&mu_);
    if (absl::Status s = Unavailable(); !s.ok()) return s;
    if (maps_.contains(id)) {
      return absl::AlreadyExistsError(absl::StrFormat("map '%s' exists already", id));
    }
    if (maps_.size() >= options_.max_maps) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("map '%s' would be number %d, limit %d; delete one first", id,
                          maps_.size() + 1, options_.max_maps));
    }
  }
  const uint64_t epoch = NewEpoch();
  std::shared_ptr<MapFolder> folder;
  if (options_.storage) {
    auto made = options_.storage->CreateMap(std::string(id), EncodeMapConfig(config), epoch);
    if (!made.ok()) return made.status();
    folder = *std::move(made);
  }
  auto engine = std::make_shared<MappingEngine>(
      std::string(id), MapState{config, options_.model(config), {}, 0}, std::move(folder), epoch,
      &timers_, options_.engine);
  MutexLock lock(&mu_);
  maps_.emplace(id, engine);
  return engine;
}

absl::StatusOr<MapRegistry::EnginePtr> MapRegistry::Get(std::string_view id) const {
  if (id.empty()) id = kDefaultMapId;
  if (absl::Status status = ValidateId(id, "map"); !status.ok()) return status;
  MutexLock lock(&mu_);
  if (loading_) return Unavailable();
  if (restoring_.contains(id)) {
    return absl::UnavailableError(absl::StrFormat("map '%s' is being restored; try again", id));
  }
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
  MutexLock change(&change_mu_);
  EnginePtr engine;
  {
    MutexLock lock(&mu_);
    if (loading_) return Unavailable();
    const auto it = maps_.find(id);
    if (it == maps_.end()) return NotFound(id);
    engine = std::move(it->second);
    maps_.erase(it);
  }
  engine->Stop();
  if (options_.storage) {
    if (absl::Status s = options_.storage->DeleteMap(engine->id()); !s.ok()) return s;
  }
  return engine;
}

absl::Status MapRegistry::CreateSnapshot(std::string_view id, std::string snapshot_id,
                                         std::string comment, Snapshotter::Done done) {
  const absl::StatusOr<EnginePtr> engine = Get(id);
  if (!engine.ok()) return engine.status();
  if (!snapshotter_) {
    return absl::FailedPreconditionError(
        "snapshots need a folder: set store.dir in the server's configuration");
  }
  return snapshotter_->Create(*engine, std::move(snapshot_id), std::move(comment), false,
                              std::move(done));
}

absl::StatusOr<MapRegistry::EnginePtr> MapRegistry::RestoreSnapshot(
    std::string_view id, const std::string& snapshot_id, const std::function<void()>& before_swap) {
  MutexLock change(&change_mu_);
  const absl::StatusOr<EnginePtr> old = Get(id);
  if (!old.ok()) return old.status();
  const std::string name = (*old)->id();
  const std::shared_ptr<MapFolder> folder = (*old)->folder();
  if (!folder) {
    return absl::FailedPreconditionError(
        "snapshots need a folder: set store.dir in the server's configuration");
  }
  if (absl::Status s = ValidateSnapshotId(snapshot_id); !s.ok()) return s;
  const absl::StatusOr<SnapshotManifest> manifest = folder->FindSnapshot(snapshot_id);
  if (!manifest.ok()) return manifest.status();
  absl::StatusOr<MapState> state = LoadSnapshot(*folder, *manifest, Recovery());
  if (!state.ok()) return state.status();
  {
    MutexLock lock(&mu_);
    if (absl::Status s = Unavailable(); !s.ok()) return s;
    restoring_.insert(name);
  }
  before_swap();
  (*old)->Stop();
  const uint64_t epoch = NewEpoch();
  const absl::Status started = folder->StartLineage(epoch, *manifest);
  // Where the new log could not be begun the map stays, with its thread begun anew.
  absl::StatusOr<MapState> next = started.ok() ? std::move(state) : (*old)->TakeState();
  EnginePtr engine;
  if (next.ok()) {
    engine = std::make_shared<MappingEngine>(name, *std::move(next), folder, epoch, &timers_,
                                             options_.engine);
  }
  MutexLock lock(&mu_);
  restoring_.erase(name);
  if (engine) maps_[name] = engine;
  if (!started.ok()) return started;
  return engine;
}

SnapshotterStats MapRegistry::snapshot_stats() const {
  return snapshotter_ ? snapshotter_->Stats() : SnapshotterStats{};
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
  if (snapshotter_) snapshotter_->Stop();
  for (const EnginePtr& engine : List()) engine->Stop();
}

}  // namespace clearance
