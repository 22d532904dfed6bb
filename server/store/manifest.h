// What a snapshot says of itself: manifest.json beside its files.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace clearance {

struct SnapshotManifest {
  static constexpr uint32_t kFormatVersion = 1;

  struct FileEntry {
    std::string name;
    uint64_t bytes = 0;
    uint32_t crc32c = 0;
  };

  uint32_t format_version = kFormatVersion;
  std::string map, snapshot_id, comment;
  bool automatic = false;  // made by the timer
  // The state that it holds.
  uint64_t epoch = 0, revision = 0, field_revision = 0;
  int64_t stamp_ns = 0;
  // Records of this log up to this one are in the snapshot.
  uint64_t lineage = 0, log_index = 0;
  int64_t created_unix_ns = 0;
  std::string config;  // the map's, opaque
  std::vector<FileEntry> files;

  uint64_t total_bytes() const;
};

// JSON text with a checksum of its own content.
std::string EncodeManifest(const SnapshotManifest& manifest);
// FAILED_PRECONDITION where a newer version wrote it, DATA_LOSS where it is damaged.
absl::StatusOr<SnapshotManifest> DecodeManifest(std::string_view text);

// The same for any small document: {"<what>": content, "crc32c": ...}. `content` is JSON text.
std::string SealJson(std::string_view what, std::string_view content);
absl::StatusOr<std::string> OpenSealedJson(std::string_view what, std::string_view text,
                                           uint32_t newest_version);

// Bytes as lower-case hexadecimal digits and back (empty where they are none).
std::string ToHex(std::string_view bytes);
std::string FromHex(std::string_view digits);

}  // namespace clearance
