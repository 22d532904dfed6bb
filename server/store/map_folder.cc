#include "server/store/map_folder.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace clearance {
namespace {

using Json = nlohmann::ordered_json;
constexpr char kMapFile[] = "/map.json", kSnapshots[] = "/snapshots";
constexpr uint32_t kMapVersion = 1;

std::string EncodeMapFile(const std::string& map, const std::string& config, uint64_t lineage,
                          const std::string& base) {
  const Json json = {{"format_version", kMapVersion},
                     {"id", map},
                     {"config", ToHex(config)},
                     {"lineage", lineage},
                     {"base_snapshot", base}};
  return SealJson("map", json.dump());
}

absl::Status RemoveLeftOvers(const std::string& path, const std::string& current_log) {
  std::error_code error;
  std::vector<std::string> gone;
  for (std::filesystem::directory_iterator it(path, error), end; !error && it != end;
       it.increment(error)) {
    const std::string name = it->path().filename();
    if (name.starts_with("log-") && it->path() != current_log) gone.push_back(it->path());
    if (name.ends_with(".new")) gone.push_back(it->path());
  }
  for (std::filesystem::directory_iterator it(path + kSnapshots, error), end; !error && it != end;
       it.increment(error)) {
    if (it->path().filename().string().starts_with('.')) gone.push_back(it->path());
  }
  for (const std::string& name : gone) {
    if (absl::Status s = RemoveAll(name); !s.ok()) return s;
  }
  return absl::OkStatus();
}

}  // namespace

MapFolder::MapFolder(std::string path, std::string map, const LogOptions& options)
    : path_(std::move(path)), map_(std::move(map)), options_(options) {}

std::string MapFolder::LogFolder(uint64_t lineage) const {
  return absl::StrFormat("%s/log-%016x", path_, lineage);
}

absl::Status MapFolder::Create(const std::string& path, const std::string& map,
                               const std::string& config, uint64_t lineage,
                               const LogOptions& options) {
  if (absl::Status s = MakeFolder(path + kSnapshots); !s.ok()) return s;
  LogOptions quiet = options;
  quiet.sync = SyncPolicy::kEach;
  const MapFolder folder(path, map, options);
  const auto log = SegmentLog::Create(folder.LogFolder(lineage), lineage, 1, quiet);
  if (!log.ok()) return log.status();
  if (absl::Status s = ReplaceFile(path + kMapFile, EncodeMapFile(map, config, lineage, ""));
      !s.ok()) {
    return s;
  }
  return SyncFolder(path);
}

absl::StatusOr<std::unique_ptr<MapFolder>> MapFolder::Open(const std::string& path,
                                                           const std::string& map,
                                                           const LogOptions& options) {
  const absl::StatusOr<std::string> text = ReadFile(path + kMapFile);
  if (!text.ok()) return absl::DataLossError(std::string(text.status().message()));
  const absl::StatusOr<std::string> content = OpenSealedJson("map", *text, kMapVersion);
  if (!content.ok()) {
    return absl::Status(
        content.status().code(),
        absl::StrFormat("%s%s: %s", path, kMapFile, std::string(content.status().message())));
  }
  std::unique_ptr<MapFolder> folder(new MapFolder(path, map, options));
  try {
    const Json json = Json::parse(*content);
    folder->config_ = FromHex(json.at("config").get<std::string>());
    json.at("lineage").get_to(folder->lineage_);
    json.at("base_snapshot").get_to(folder->base_);
  } catch (const std::exception& error) {
    return absl::DataLossError(absl::StrFormat("%s%s: %s", path, kMapFile, error.what()));
  }
  const std::string log_folder = folder->LogFolder(folder->lineage_);
  if (absl::Status s = RemoveLeftOvers(path, log_folder); !s.ok()) return s;
  auto log = SegmentLog::Open(log_folder, folder->lineage_, options);
  if (!log.ok()) return log.status();
  folder->log_ = *std::move(log);
  return folder;
}

std::string MapFolder::config() const {
  std::lock_guard lock(mu_);
  return config_;
}

uint64_t MapFolder::lineage() const {
  std::lock_guard lock(mu_);
  return lineage_;
}

std::string MapFolder::base_snapshot() const {
  std::lock_guard lock(mu_);
  return base_;
}

std::shared_ptr<SegmentLog> MapFolder::log() const {
  std::lock_guard lock(mu_);
  return log_;
}

std::string MapFolder::SnapshotFolder(const std::string& id) const {
  return absl::StrFormat("%s%s/%s", path_, kSnapshots, id);
}

absl::StatusOr<SnapshotWriter> MapFolder::BeginSnapshot(const std::string& id) {
  return SnapshotWriter::Begin(path_ + kSnapshots, id);
}

std::vector<SnapshotManifest> MapFolder::Snapshots(std::vector<std::string>* damaged) const {
  std::vector<SnapshotManifest> found;
  const auto names = ListFolder(path_ + kSnapshots);
  if (!names.ok()) return found;
  for (const std::string& name : *names) {
    auto manifest = ReadManifest(SnapshotFolder(name));
    if (manifest.ok()) {
      found.push_back(*std::move(manifest));
    } else if (damaged != nullptr) {
      damaged->push_back(name);
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return a.created_unix_ns > b.created_unix_ns;
  });
  return found;
}

absl::StatusOr<SnapshotManifest> MapFolder::FindSnapshot(const std::string& id) const {
  auto manifest = ReadManifest(SnapshotFolder(id));
  if (!absl::IsNotFound(manifest.status())) return manifest;
  const std::string existing = absl::StrJoin(
      Snapshots(), ", ", [](std::string* out, const auto& m) { out->append(m.snapshot_id); });
  return absl::NotFoundError(
      absl::StrFormat("snapshot '%s' of map '%s' does not exist. Snapshots: %s", id, map_,
                      existing.empty() ? "none" : existing));
}

std::vector<SnapshotManifest> MapFolder::RecoverySnapshots() const {
  const uint64_t lineage = this->lineage();
  const std::string base = base_snapshot();
  std::vector<SnapshotManifest> found = Snapshots();
  std::vector<SnapshotManifest> usable;
  for (const SnapshotManifest& m : found) {
    if (m.lineage == lineage) usable.push_back(m);
  }
  // By what they hold: clocks may go back.
  std::stable_sort(usable.begin(), usable.end(),
                   [](const auto& a, const auto& b) { return a.log_index > b.log_index; });
  for (const SnapshotManifest& m : found) {
    if (m.snapshot_id != base) continue;
    usable.push_back(m);
    usable.back().log_index = 0;  // the lineage's log starts behind it
  }
  return usable;
}

absl::Status MapFolder::DeleteSnapshot(const std::string& id) {
  const absl::StatusOr<SnapshotManifest> found = FindSnapshot(id);
  if (absl::IsNotFound(found.status())) return found.status();
  const bool recovers = found.ok() && (found->lineage == lineage() || id == base_snapshot());
  if (recovers) {
    // What would be left to start from: an earlier log, or another snapshot that it continues.
    const uint64_t first = log()->Stats().first_index;
    bool left = first == 1 && base_snapshot().empty();
    for (const SnapshotManifest& m : RecoverySnapshots()) {
      left |= m.snapshot_id != id && m.log_index + 1 >= first;
    }
    if (!left) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "snapshot '%s' is what map '%s' would be recovered from; create another one first", id,
          map_));
    }
  }
  return RemoveSnapshot(id);
}

absl::Status MapFolder::RemoveSnapshot(const std::string& id) {
  // Hidden first, so that a crash in the middle leaves nothing half.
  const std::string hidden = absl::StrFormat("%s%s/.deleted-%s", path_, kSnapshots, id);
  if (absl::Status s = RenameSynced(SnapshotFolder(id), hidden); !s.ok()) return s;
  return RemoveAll(hidden);
}

void MapFolder::Prune(size_t keep) {
  if (keep == 0) return;
  const uint64_t lineage = this->lineage();
  const std::string base = base_snapshot();
  size_t automatic = 0, own = 0;
  uint64_t oldest_kept = 0;
  for (const SnapshotManifest& m : Snapshots()) {
    if (m.automatic && ++automatic > keep && m.snapshot_id != base) {
      RemoveSnapshot(m.snapshot_id).IgnoreError();
      continue;
    }
    if (m.lineage == lineage && ++own <= keep) oldest_kept = m.log_index;
  }
  if (own >= keep) log()->Forget(oldest_kept);
}

absl::Status MapFolder::StartLineage(uint64_t lineage, const SnapshotManifest& base) {
  absl::StatusOr<std::unique_ptr<SegmentLog>> log =
      SegmentLog::Create(LogFolder(lineage), lineage, 1, options_);
  if (!log.ok()) return log.status();
  std::shared_ptr<SegmentLog> old_log;
  std::string old_folder;
  {
    std::lock_guard lock(mu_);
    const absl::Status replaced =
        ReplaceFile(path_ + kMapFile, EncodeMapFile(map_, base.config, lineage, base.snapshot_id));
    if (!replaced.ok()) {
      log->reset();
      RemoveAll(LogFolder(lineage)).IgnoreError();
      return replaced;
    }
    old_folder = LogFolder(lineage_);
    old_log = std::exchange(log_, *std::move(log));
    config_ = base.config;
    lineage_ = lineage;
    base_ = base.snapshot_id;
  }
  RemoveAll(old_folder).IgnoreError();  // else the next start does it
  return absl::OkStatus();
}

}  // namespace clearance
