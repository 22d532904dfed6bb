#include "server/store/snapshot_files.h"

#include <filesystem>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/core/crc32c.h"
#include "server/store/file.h"

namespace clearance {

absl::StatusOr<SnapshotWriter> SnapshotWriter::Begin(const std::string& snapshots,
                                                     const std::string& id) {
  SnapshotWriter writer(absl::StrFormat("%s/.writing-%s", snapshots, id),
                        absl::StrFormat("%s/%s", snapshots, id));
  if (std::filesystem::exists(writer.folder_)) {
    return absl::AlreadyExistsError(absl::StrFormat("snapshot '%s' exists already", id));
  }
  if (absl::Status s = RemoveAll(writer.aside_); !s.ok()) return s;
  if (absl::Status s = MakeFolder(writer.aside_); !s.ok()) return s;
  return writer;
}

SnapshotWriter::SnapshotWriter(SnapshotWriter&& other) noexcept
    : aside_(std::exchange(other.aside_, "")),
      folder_(std::move(other.folder_)),
      files_(std::move(other.files_)) {}

SnapshotWriter::~SnapshotWriter() {
  if (!aside_.empty()) RemoveAll(aside_).IgnoreError();
}

absl::Status SnapshotWriter::Add(std::string_view name, std::string_view bytes) {
  files_.push_back({std::string(name), bytes.size(), Crc32c(bytes)});
  return WriteFileSynced(absl::StrFormat("%s/%s", aside_, name), bytes);
}

absl::Status SnapshotWriter::Commit(SnapshotManifest* manifest) {
  manifest->files = files_;
  if (absl::Status s = WriteFileSynced(aside_ + "/" + kManifestFile, EncodeManifest(*manifest));
      !s.ok()) {
    return s;
  }
  if (absl::Status s = SyncFolder(aside_); !s.ok()) return s;
  if (std::filesystem::exists(folder_)) {
    return absl::AlreadyExistsError(
        absl::StrFormat("snapshot '%s' exists already", manifest->snapshot_id));
  }
  if (absl::Status s = RenameSynced(aside_, folder_); !s.ok()) return s;
  aside_.clear();
  return absl::OkStatus();
}

absl::StatusOr<SnapshotManifest> ReadManifest(const std::string& folder) {
  const absl::StatusOr<std::string> text = ReadFile(folder + "/" + kManifestFile);
  if (!text.ok()) {
    if (!absl::IsNotFound(text.status()) || !std::filesystem::exists(folder)) return text.status();
    return absl::DataLossError(absl::StrFormat("%s has no manifest", folder));
  }
  absl::StatusOr<SnapshotManifest> manifest = DecodeManifest(*text);
  if (manifest.ok()) return manifest;
  return absl::Status(manifest.status().code(),
                      absl::StrFormat("%s: %s", folder, std::string(manifest.status().message())));
}

absl::StatusOr<std::string> ReadSnapshotFile(const std::string& folder,
                                             const SnapshotManifest& manifest,
                                             std::string_view name) {
  const SnapshotManifest::FileEntry* entry = nullptr;
  for (const auto& file : manifest.files) {
    if (file.name == name) entry = &file;
  }
  if (entry == nullptr) {
    return absl::DataLossError(absl::StrFormat("%s: the manifest lists no %s", folder, name));
  }
  absl::StatusOr<std::string> bytes = ReadFile(absl::StrFormat("%s/%s", folder, name));
  if (!bytes.ok()) {
    return absl::DataLossError(std::string(bytes.status().message()));
  }
  if (bytes->size() != entry->bytes) {
    return absl::DataLossError(absl::StrFormat("%s/%s: got %d bytes, the manifest says %d", folder,
                                               name, bytes->size(), entry->bytes));
  }
  if (Crc32c(*bytes) != entry->crc32c) {
    return absl::DataLossError(absl::StrFormat("%s/%s has a wrong checksum", folder, name));
  }
  return bytes;
}

}  // namespace clearance
