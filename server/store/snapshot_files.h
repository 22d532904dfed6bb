// One snapshot as a folder: its files and a manifest, complete or not there at all.
#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/store/manifest.h"

namespace clearance {

inline constexpr char kManifestFile[] = "manifest.json";

// Writes aside, in <snapshots>/.writing-<id>; Commit renames. What is not committed is removed.
class SnapshotWriter {
 public:
  static absl::StatusOr<SnapshotWriter> Begin(const std::string& snapshots, const std::string& id);
  SnapshotWriter(SnapshotWriter&& other) noexcept;
  ~SnapshotWriter();

  absl::Status Add(std::string_view name, std::string_view bytes);
  // Fills in manifest->files. ALREADY_EXISTS where the snapshot has come to exist meanwhile.
  absl::Status Commit(SnapshotManifest* manifest);

 private:
  SnapshotWriter(std::string aside, std::string folder)
      : aside_(std::move(aside)), folder_(std::move(folder)) {}

  std::string aside_, folder_;
  std::vector<SnapshotManifest::FileEntry> files_;
};

// The manifest of a snapshot's folder. NOT_FOUND, DATA_LOSS, FAILED_PRECONDITION.
absl::StatusOr<SnapshotManifest> ReadManifest(const std::string& folder);
// One file, checked against the manifest: DATA_LOSS naming it otherwise.
absl::StatusOr<std::string> ReadSnapshotFile(const std::string& folder,
                                             const SnapshotManifest& manifest,
                                             std::string_view name);

}  // namespace clearance
