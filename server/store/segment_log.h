// The frame log as segment files in a folder of its own, named by their first record.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "server/store/file.h"
#include "server/store/flusher.h"
#include "server/store/frame_log.h"

namespace clearance {

enum class SyncPolicy {
  kEach,      // every record, before Append returns
  kInterval,  // by a flusher: a crash of the machine loses what came since, one of the process none
  kOff,       // when the system likes
};

struct LogOptions {
  SyncPolicy sync = SyncPolicy::kInterval;
  uint64_t segment_bytes = 64u << 20;  // a segment that is larger ends
  // Damage is an error unless this is set: then the log ends before it, and what follows is kept
  // aside as *.damaged.
  bool recover_damaged = false;
  Flusher* flusher = nullptr;  // required by kInterval; outlives the log
};

// What the process or the machine left incomplete at the end of the last segment (a record that was
// never acknowledged, with kEach) is cut off when the log is opened.
class SegmentLog final : public FrameLog {
 public:
  // A new, empty log; its first record will be `first_index`. The folder must not exist.
  static absl::StatusOr<std::unique_ptr<SegmentLog>> Create(const std::string& folder,
                                                            uint64_t lineage, uint64_t first_index,
                                                            const LogOptions& options);
  // DATA_LOSS where the folder or its newest segment is damaged.
  static absl::StatusOr<std::unique_ptr<SegmentLog>> Open(const std::string& folder,
                                                          uint64_t lineage,
                                                          const LogOptions& options);
  ~SegmentLog() override;

  absl::StatusOr<uint64_t> Append(std::string_view head, std::string_view body) override;
  absl::Status Sync() override;
  absl::Status Replay(uint64_t after, const Visitor& visit) override;
  void Forget(uint64_t index) override;
  LogStats Stats() const override;

  // What Open cut off, for a message; empty where nothing.
  const std::string& repaired() const { return repaired_; }
  // Makes the next record `index` where the log ends before: what lies between is in a snapshot.
  absl::Status SkipTo(uint64_t index);

 private:
  SegmentLog(std::string folder, uint64_t lineage, const LogOptions& options);

  std::string PathOf(uint64_t first_index) const;
  absl::Status StartSegment(uint64_t first_index);
  absl::Status EndOf(uint64_t first_index, uint64_t* next_index);
  absl::Status CutAt(uint64_t first_index, uint64_t valid_bytes, uint64_t next_index);
  absl::Status SyncLocked();

  const std::string folder_;
  const uint64_t lineage_;
  const LogOptions options_;
  std::string repaired_;
  uint64_t flush_id_ = 0;

  mutable std::mutex mu_;                  // guards all below
  std::map<uint64_t, uint64_t> segments_;  // bytes by first index; the last is being written
  File file_;
  uint64_t next_index_ = 1;
  bool dirty_ = false;
  absl::Status broken_;
  LogStats stats_;
};

}  // namespace clearance
