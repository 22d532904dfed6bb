// The folder that holds everything durable of one server.
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "server/store/map_folder.h"

namespace clearance {

struct StoreOptions {
  std::string path;
  SyncPolicy sync = SyncPolicy::kInterval;
  std::chrono::milliseconds sync_interval{200};
  uint64_t segment_bytes = 64u << 20;
  bool recover_damaged = false;
};

// Thread-safe. Outlives the folders that it opened.
class DataDirectory {
 public:
  // Makes the folder where it is missing and locks it. FAILED_PRECONDITION where another server
  // has it.
  static absl::StatusOr<std::unique_ptr<DataDirectory>> Open(const StoreOptions& options);

  absl::StatusOr<std::vector<std::string>> Maps() const;
  absl::StatusOr<std::unique_ptr<MapFolder>> OpenMap(const std::string& map) const;
  // Complete or not at all. ALREADY_EXISTS.
  absl::StatusOr<std::unique_ptr<MapFolder>> CreateMap(const std::string& map,
                                                       const std::string& config,
                                                       uint64_t lineage) const;
  // With its log and its snapshots.
  absl::Status DeleteMap(const std::string& map) const;

  const std::string& path() const { return options_.path; }

 private:
  explicit DataDirectory(const StoreOptions& options);
  std::string MapPath(const std::string& map) const;

  const StoreOptions options_;
  File lock_;
  std::unique_ptr<Flusher> flusher_;
  LogOptions log_options_;
};

}  // namespace clearance
