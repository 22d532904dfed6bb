#include "server/store/data_directory.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <filesystem>

#include "absl/strings/str_format.h"

namespace clearance {

DataDirectory::DataDirectory(const StoreOptions& options) : options_(options) {
  log_options_.sync = options.sync;
  log_options_.segment_bytes = options.segment_bytes;
  log_options_.recover_damaged = options.recover_damaged;
  if (options.sync == SyncPolicy::kInterval) {
    flusher_ = std::make_unique<Flusher>(options.sync_interval);
    log_options_.flusher = flusher_.get();
  }
}

std::string DataDirectory::MapPath(const std::string& map) const {
  return absl::StrFormat("%s/maps/%s", options_.path, map);
}

absl::StatusOr<std::unique_ptr<DataDirectory>> DataDirectory::Open(const StoreOptions& options) {
  std::unique_ptr<DataDirectory> directory(new DataDirectory(options));
  const std::string maps = options.path + "/maps";
  if (absl::Status s = MakeFolder(maps); !s.ok()) return s;
  absl::StatusOr<File> lock = File::Open(options.path + "/lock", O_RDWR | O_CREAT);
  if (!lock.ok()) return lock.status();
  // Held by the open file: the system lets go when the process ends, however it ends.
  if (flock(lock->fd(), LOCK_EX | LOCK_NB) != 0) {
    const std::string owner = ReadFile(options.path + "/lock").value_or("");
    return absl::FailedPreconditionError(
        absl::StrFormat("%s is in use by another server (process %s); stop it or choose another "
                        "folder",
                        options.path, owner.empty() ? "unknown" : owner));
  }
  const std::string pid = std::to_string(getpid());
  if (absl::Status s = lock->Truncate(0); !s.ok()) return s;
  if (absl::Status s = lock->WriteAt(pid, 0); !s.ok()) return s;
  directory->lock_ = *std::move(lock);
  // What a crash left of a map that was being made or deleted.
  std::error_code error;
  std::vector<std::string> gone;
  for (std::filesystem::directory_iterator it(maps, error), end; !error && it != end;
       it.increment(error)) {
    if (it->path().filename().string().starts_with('.')) gone.push_back(it->path());
  }
  for (const std::string& path : gone) {
    if (absl::Status s = RemoveAll(path); !s.ok()) return s;
  }
  return directory;
}

absl::StatusOr<std::vector<std::string>> DataDirectory::Maps() const {
  return ListFolder(options_.path + "/maps");
}

absl::StatusOr<std::unique_ptr<MapFolder>> DataDirectory::OpenMap(const std::string& map) const {
  return MapFolder::Open(MapPath(map), map, log_options_);
}

absl::StatusOr<std::unique_ptr<MapFolder>> DataDirectory::CreateMap(const std::string& map,
                                                                    const std::string& config,
                                                                    uint64_t lineage) const {
  const std::string path = MapPath(map), aside = MapPath(".new-" + map);
  if (std::filesystem::exists(path)) {
    return absl::AlreadyExistsError(absl::StrFormat("%s exists already", path));
  }
  if (absl::Status s = RemoveAll(aside); !s.ok()) return s;
  absl::Status made = MapFolder::Create(aside, map, config, lineage, log_options_);
  if (made.ok()) made = RenameSynced(aside, path);
  if (!made.ok()) {
    RemoveAll(aside).IgnoreError();
    return made;
  }
  return OpenMap(map);
}

absl::Status DataDirectory::DeleteMap(const std::string& map) const {
  const std::string hidden = MapPath(".deleted-" + map);
  if (absl::Status s = RemoveAll(hidden); !s.ok()) return s;
  if (absl::Status s = RenameSynced(MapPath(map), hidden); !s.ok()) return s;
  return RemoveAll(hidden);
}

}  // namespace clearance
