// Files that are there or not there, never half.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace clearance {

// The error number of a file operation as a status naming what was tried on which path:
// RESOURCE_EXHAUSTED where there is no room, NOT_FOUND, PERMISSION_DENIED, else INTERNAL.
absl::Status FileError(int error, std::string_view what, const std::string& path);

// An open file, closed by its end. Not thread-safe.
class File {
 public:
  File() = default;
  File(File&& other) noexcept : path_(std::move(other.path_)), fd_(other.fd_) { other.fd_ = -1; }
  File& operator=(File&& other) noexcept;
  ~File();

  // `flags` as of open(2).
  static absl::StatusOr<File> Open(const std::string& path, int flags);

  static File Adopt(const std::string& path, int fd);

  const std::string& path() const { return path_; }
  int fd() const { return fd_; }
  absl::StatusOr<uint64_t> Size() const;
  // All of `bytes` at `offset`, or an error; part of them may then be there.
  absl::Status WriteAt(std::string_view bytes, uint64_t offset);
  absl::Status Truncate(uint64_t size);
  // Data and size reach the disk.
  absl::Status Sync();

 private:
  std::string path_;
  int fd_ = -1;
};

absl::StatusOr<std::string> ReadFile(const std::string& path);
// Creates `path` and syncs it, but not the folder that names it.
absl::Status WriteFileSynced(const std::string& path, std::string_view bytes);
// Written aside, synced, renamed, folder synced: afterwards there is the old content or the new.
absl::Status ReplaceFile(const std::string& path, std::string_view bytes);
// Renames and syncs the folder that names both.
absl::Status RenameSynced(const std::string& from, const std::string& to);
// New and removed names in the folder reach the disk.
absl::Status SyncFolder(const std::string& path);
absl::Status MakeFolder(const std::string& path);  // with its parents
absl::Status RemoveAll(const std::string& path);   // gone already is fine
// Names of what a folder holds, sorted; those that start with '.' are left out.
absl::StatusOr<std::vector<std::string>> ListFolder(const std::string& path);

}  // namespace clearance
