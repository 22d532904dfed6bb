#include "server/store/file.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "absl/strings/str_format.h"

namespace clearance {

absl::Status FileError(int error, std::string_view what, const std::string& path) {
  const std::string text = absl::StrFormat("%s %s: %s", what, path, std::strerror(error));
  switch (error) {
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
    case EMFILE:
    case ENFILE:
      return absl::ResourceExhaustedError(text);
    case ENOENT:
      return absl::NotFoundError(text);
    case EACCES:
    case EPERM:
    case EROFS:
      return absl::PermissionDeniedError(text);
    default:
      return absl::InternalError(text);
  }
}

File& File::operator=(File&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(fd_, other.fd_);
  return *this;
}

File::~File() {
  if (fd_ >= 0) close(fd_);
}

absl::StatusOr<File> File::Open(const std::string& path, int flags) {
  File file;
  file.path_ = path;
  file.fd_ = open(path.c_str(), flags | O_CLOEXEC, 0640);
  if (file.fd_ < 0) return FileError(errno, "cannot open", path);
  return file;
}

File File::Adopt(const std::string& path, int fd) {
  File file;
  file.path_ = path;
  file.fd_ = fd;
  return file;
}

absl::StatusOr<uint64_t> File::Size() const {
  struct stat info;
  if (fstat(fd_, &info) != 0) return FileError(errno, "cannot look at", path_);
  return static_cast<uint64_t>(info.st_size);
}

absl::Status File::WriteAt(std::string_view bytes, uint64_t offset) {
  while (!bytes.empty()) {
    const ssize_t n = pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return FileError(errno, "cannot write", path_);
    if (n == 0) return FileError(ENOSPC, "cannot write", path_);
    bytes.remove_prefix(static_cast<size_t>(n));
    offset += static_cast<uint64_t>(n);
  }
  return absl::OkStatus();
}

absl::Status File::Truncate(uint64_t size) {
  if (ftruncate(fd_, static_cast<off_t>(size)) == 0) return absl::OkStatus();
  return FileError(errno, "cannot cut", path_);
}

absl::Status File::Sync() {
  if (fdatasync(fd_) == 0) return absl::OkStatus();
  return FileError(errno, "cannot sync", path_);
}

absl::StatusOr<std::string> ReadFile(const std::string& path) {
  const absl::StatusOr<File> file = File::Open(path, O_RDONLY);
  if (!file.ok()) return file.status();
  const absl::StatusOr<uint64_t> size = file->Size();
  if (!size.ok()) return size.status();
  std::string bytes(*size, '\0');
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = read(file->fd(), bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return FileError(errno, "cannot read", path);
    if (n == 0) break;  // shorter than it was a moment ago
    done += static_cast<size_t>(n);
  }
  bytes.resize(done);
  return bytes;
}

absl::Status WriteFileSynced(const std::string& path, std::string_view bytes) {
  absl::StatusOr<File> file = File::Open(path, O_WRONLY | O_CREAT | O_TRUNC);
  if (!file.ok()) return file.status();
  if (absl::Status s = file->WriteAt(bytes, 0); !s.ok()) return s;
  return file->Sync();
}

absl::Status ReplaceFile(const std::string& path, std::string_view bytes) {
  const std::string aside = path + ".new";
  if (absl::Status s = WriteFileSynced(aside, bytes); !s.ok()) {
    unlink(aside.c_str());
    return s;
  }
  return RenameSynced(aside, path);
}

absl::Status RenameSynced(const std::string& from, const std::string& to) {
  if (rename(from.c_str(), to.c_str()) != 0) return FileError(errno, "cannot rename", from);
  return SyncFolder(std::filesystem::path(to).parent_path());
}

absl::Status SyncFolder(const std::string& path) {
  absl::StatusOr<File> folder = File::Open(path, O_RDONLY | O_DIRECTORY);
  if (!folder.ok()) return folder.status();
  if (fsync(folder->fd()) == 0) return absl::OkStatus();
  return FileError(errno, "cannot sync", path);
}

absl::Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  return error ? FileError(error.value(), "cannot make", path) : absl::OkStatus();
}

absl::Status RemoveAll(const std::string& path) {
  std::error_code error;
  std::filesystem::remove_all(path, error);
  return error ? FileError(error.value(), "cannot remove", path) : absl::OkStatus();
}

absl::StatusOr<std::vector<std::string>> ListFolder(const std::string& path) {
  std::error_code error;
  std::vector<std::string> names;
  for (std::filesystem::directory_iterator it(path, error), end; !error && it != end;
       it.increment(error)) {
    std::string name = it->path().filename();
    if (name[0] != '.') names.push_back(std::move(name));
  }
  if (error) return FileError(error.value(), "cannot list", path);
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace clearance
