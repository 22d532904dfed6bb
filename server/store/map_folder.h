// What is on disk of one map: configuration, log, snapshots.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "server/store/segment_log.h"
#include "server/store/snapshot_files.h"

namespace clearance {

// A log follows one lineage of states: it starts empty, or at a snapshot that was restored. Each
// restore starts a new lineage, so that what came after that snapshot before is never replayed.
//   map.json                configuration, lineage, the snapshot it starts from
//   log-<lineage>/          segments
//   snapshots/<id>/         of any lineage
// Thread-safe.
class MapFolder {
 public:
  static absl::Status Create(const std::string& path, const std::string& map,
                             const std::string& config, uint64_t lineage,
                             const LogOptions& options);
  static absl::StatusOr<std::unique_ptr<MapFolder>> Open(const std::string& path,
                                                         const std::string& map,
                                                         const LogOptions& options);

  const std::string& map() const { return map_; }
  const std::string& path() const { return path_; }
  std::string config() const;
  uint64_t lineage() const;
  // The snapshot from which the lineage starts; empty: from nothing.
  std::string base_snapshot() const;
  // Of the present lineage. Stays valid for its holders after a restore.
  std::shared_ptr<SegmentLog> log() const;

  std::string SnapshotFolder(const std::string& id) const;
  absl::StatusOr<SnapshotWriter> BeginSnapshot(const std::string& id);
  // Readable ones, newest first by their creation; others by name in `damaged`.
  std::vector<SnapshotManifest> Snapshots(std::vector<std::string>* damaged = nullptr) const;
  // NOT_FOUND naming what exists.
  absl::StatusOr<SnapshotManifest> FindSnapshot(const std::string& id) const;
  // Those from which the map can be recovered: of this lineage, newest first, and its base last.
  std::vector<SnapshotManifest> RecoverySnapshots() const;
  // FAILED_PRECONDITION where recovery needs it: the log does not reach back before it.
  absl::Status DeleteSnapshot(const std::string& id);
  // Deletes automatic snapshots beyond the newest `keep` (0 = none), and log segments wholly before
  // the oldest of the newest `keep` snapshots of this lineage.
  void Prune(size_t keep);

  // After a restore: an empty log that follows `base`. The old log is deleted.
  absl::Status StartLineage(uint64_t lineage, const SnapshotManifest& base);

 private:
  MapFolder(std::string path, std::string map, const LogOptions& options);

  std::string LogFolder(uint64_t lineage) const;
  absl::Status RemoveSnapshot(const std::string& id);

  const std::string path_, map_;
  const LogOptions options_;
  mutable std::mutex mu_;  // guards all below
  std::string config_, base_;
  uint64_t lineage_ = 0;
  std::shared_ptr<SegmentLog> log_;
};

}  // namespace clearance
