#include "server/store/segment_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "server/store/log_segment.h"

namespace clearance {
namespace {

constexpr std::string_view kSuffix = ".log";

absl::Status InSegment(const absl::Status& status, const std::string& path) {
  return absl::Status(status.code(),
                      absl::StrFormat("%s: %s", path, std::string(status.message())));
}

const RecordVisitor kSkip = [](uint64_t, std::string_view) { return absl::OkStatus(); };

}  // namespace

SegmentLog::SegmentLog(std::string folder, uint64_t lineage, const LogOptions& options)
    : folder_(std::move(folder)), lineage_(lineage), options_(options) {}

SegmentLog::~SegmentLog() {
  if (flush_id_ != 0) options_.flusher->Remove(flush_id_);
  Sync().IgnoreError();
}

std::string SegmentLog::PathOf(uint64_t first_index) const {
  return absl::StrFormat("%s/%020d%s", folder_, first_index, kSuffix);
}

absl::StatusOr<std::unique_ptr<SegmentLog>> SegmentLog::Create(const std::string& folder,
                                                               uint64_t lineage,
                                                               uint64_t first_index,
                                                               const LogOptions& options) {
  if (absl::Status s = MakeFolder(folder); !s.ok()) return s;
  std::unique_ptr<SegmentLog> log(new SegmentLog(folder, lineage, options));
  {
    std::lock_guard lock(log->mu_);
    if (absl::Status s = log->StartSegment(first_index); !s.ok()) return s;
  }
  if (options.sync == SyncPolicy::kInterval) {
    log->flush_id_ = options.flusher->Add([l = log.get()] { l->Sync().IgnoreError(); });
  }
  return log;
}

absl::StatusOr<std::unique_ptr<SegmentLog>> SegmentLog::Open(const std::string& folder,
                                                             uint64_t lineage,
                                                             const LogOptions& options) {
  const absl::StatusOr<std::vector<std::string>> names = ListFolder(folder);
  if (!names.ok()) {
    return absl::DataLossError(
        absl::StrFormat("the frame log is gone: %s", std::string(names.status().message())));
  }
  std::unique_ptr<SegmentLog> log(new SegmentLog(folder, lineage, options));
  std::unique_lock lock(log->mu_);
  for (const std::string& name : *names) {
    uint64_t first = 0;
    if (!name.ends_with(kSuffix) ||
        !absl::SimpleAtoi(name.substr(0, name.size() - kSuffix.size()), &first)) {
      continue;
    }
    const absl::StatusOr<File> file = File::Open(log->PathOf(first), O_RDONLY);
    if (!file.ok()) return file.status();
    const absl::StatusOr<uint64_t> size = file->Size();
    if (!size.ok()) return size.status();
    // The process stopped between making the file and writing its header: nothing is in it.
    if (*size < kSegmentHeaderBytes && !log->segments_.empty()) {
      if (absl::Status s = RemoveAll(log->PathOf(first)); !s.ok()) return s;
      continue;
    }
    log->segments_[first] = *size;
  }
  if (log->segments_.empty()) {
    return absl::DataLossError(absl::StrFormat("the frame log is gone: no segments in %s", folder));
  }
  absl::Status ended = log->EndOf(log->segments_.rbegin()->first, &log->next_index_);
  while (absl::IsDataLoss(ended) && options.recover_damaged && log->segments_.size() > 1) {
    // Not even its header is whole.
    const std::string path = log->PathOf(log->segments_.rbegin()->first);
    log->repaired_ = std::string(ended.message()) + "; kept aside as .damaged";
    if (absl::Status s = RenameSynced(path, path + ".damaged"); !s.ok()) return s;
    log->segments_.erase(std::prev(log->segments_.end()));
    ended = log->EndOf(log->segments_.rbegin()->first, &log->next_index_);
  }
  if (!ended.ok()) return ended;
  absl::StatusOr<File> file = File::Open(log->PathOf(log->segments_.rbegin()->first), O_RDWR);
  if (!file.ok()) return file.status();
  log->file_ = *std::move(file);
  lock.unlock();
  if (options.sync == SyncPolicy::kInterval) {
    log->flush_id_ = options.flusher->Add([l = log.get()] { l->Sync().IgnoreError(); });
  }
  return log;
}

// Scans the newest segment for its end; cuts what is incomplete, or damaged where allowed.
absl::Status SegmentLog::EndOf(uint64_t first_index, uint64_t* next_index) {
  const std::string path = PathOf(first_index);
  const absl::StatusOr<std::string> bytes = ReadFile(path);
  if (!bytes.ok()) return bytes.status();
  const absl::StatusOr<SegmentScan> scan = ScanSegment(*bytes, lineage_, first_index, kSkip);
  if (!scan.ok()) return InSegment(scan.status(), path);
  *next_index = scan->next_index;
  switch (scan->end) {
    case SegmentScan::End::kClean:
      return absl::OkStatus();
    case SegmentScan::End::kTorn:
      repaired_ = absl::StrFormat("%s: %s; %d bytes were cut off", path, scan->why,
                                  bytes->size() - scan->valid_bytes);
      break;
    case SegmentScan::End::kDamaged:
      if (!options_.recover_damaged) {
        return absl::DataLossError(absl::StrFormat("%s: %s", path, scan->why));
      }
      repaired_ = absl::StrFormat("%s: %s; kept aside as .damaged, the log ends before it", path,
                                  scan->why);
      if (absl::Status s = WriteFileSynced(path + ".damaged", *bytes); !s.ok()) return s;
      break;
  }
  return CutAt(first_index, scan->valid_bytes, scan->next_index);
}

absl::Status SegmentLog::CutAt(uint64_t first_index, uint64_t valid_bytes, uint64_t next_index) {
  absl::StatusOr<File> file = File::Open(PathOf(first_index), O_RDWR);
  if (!file.ok()) return file.status();
  if (absl::Status s = file->Truncate(valid_bytes); !s.ok()) return s;
  if (absl::Status s = file->Sync(); !s.ok()) return s;
  segments_[first_index] = valid_bytes;
  file_ = *std::move(file);
  next_index_ = next_index;
  return SyncFolder(folder_);
}

absl::Status SegmentLog::StartSegment(uint64_t first_index) {
  if (options_.sync != SyncPolicy::kOff && file_.fd() >= 0) {
    dirty_ = true;  // a flusher that is at it may not be done yet
    if (absl::Status s = SyncLocked(); !s.ok()) return s;
  }
  const std::string path = PathOf(first_index);
  absl::StatusOr<File> file = File::Open(path, O_RDWR | O_CREAT | O_TRUNC);
  if (!file.ok()) return file.status();
  absl::Status status = file->WriteAt(SegmentHeader(lineage_, first_index), 0);
  if (status.ok() && options_.sync != SyncPolicy::kOff) status = file->Sync();
  if (status.ok()) status = SyncFolder(folder_);
  if (!status.ok()) {
    unlink(path.c_str());
    return status;
  }
  file_ = *std::move(file);
  segments_[first_index] = kSegmentHeaderBytes;
  next_index_ = first_index;
  return absl::OkStatus();
}

absl::Status SegmentLog::SkipTo(uint64_t index) {
  std::lock_guard lock(mu_);
  return index > next_index_ ? StartSegment(index) : absl::OkStatus();
}

absl::StatusOr<uint64_t> SegmentLog::Append(std::string_view head, std::string_view body) {
  std::lock_guard lock(mu_);
  if (!broken_.ok()) return broken_;
  absl::Status status;
  if (segments_.rbegin()->second >= options_.segment_bytes) status = StartSegment(next_index_);
  uint64_t& bytes = segments_.rbegin()->second;
  const std::string start = RecordHeader(next_index_, head, body).append(head);
  if (status.ok()) status = file_.WriteAt(start, bytes);
  if (status.ok()) status = file_.WriteAt(body, bytes + start.size());
  const bool written = status.ok();
  if (written && options_.sync == SyncPolicy::kEach) {
    status = file_.Sync();
    ++stats_.syncs;
  }
  if (!status.ok()) {
    ++stats_.failed;
    // Nothing half-written stays. What a failed sync leaves on the disk nobody knows.
    const absl::Status cut = file_.Truncate(bytes);
    if (written || !cut.ok()) broken_ = cut.ok() ? status : cut;
    return status;
  }
  bytes += start.size() + body.size();
  dirty_ = options_.sync != SyncPolicy::kEach;
  ++stats_.appended;
  return next_index_++;
}

absl::Status SegmentLog::Sync() {
  // The file is synced without the lock: appends go on meanwhile.
  absl::StatusOr<File> own = absl::UnknownError("");
  {
    std::lock_guard lock(mu_);
    if (!dirty_) return broken_;
    dirty_ = false;
    const int fd = fcntl(file_.fd(), F_DUPFD_CLOEXEC, 0);
    if (fd < 0) return SyncLocked();
    own = File::Adopt(file_.path(), fd);
    ++stats_.syncs;
  }
  absl::Status status = own->Sync();
  if (!status.ok()) {
    std::lock_guard lock(mu_);
    broken_ = status;
  }
  return status;
}

absl::Status SegmentLog::SyncLocked() {
  if (!dirty_) return broken_;
  dirty_ = false;
  ++stats_.syncs;
  absl::Status status = file_.Sync();
  if (!status.ok()) broken_ = status;
  return status;
}

absl::Status SegmentLog::Replay(uint64_t after, const Visitor& visit) {
  std::map<uint64_t, uint64_t> segments;
  {
    std::lock_guard lock(mu_);
    segments = segments_;
  }
  auto it = segments.upper_bound(after + 1);
  if (it != segments.begin()) --it;
  uint64_t expected = after + 1;
  for (; it != segments.end(); ++it) {
    const std::string path = PathOf(it->first);
    if (it->first > expected) {
      return absl::DataLossError(absl::StrFormat("%s: records %d to %d before it are missing", path,
                                                 expected, it->first - 1));
    }
    const absl::StatusOr<std::string> bytes = ReadFile(path);
    if (!bytes.ok()) return bytes.status();
    const absl::StatusOr<SegmentScan> scan = ScanSegment(
        *bytes, lineage_, it->first, [&](uint64_t index, std::string_view payload) -> absl::Status {
          if (index <= after) return absl::OkStatus();
          expected = index + 1;
          return visit(index, payload);
        });
    if (!scan.ok()) return InSegment(scan.status(), path);
    const bool last = std::next(it) == segments.end();
    if (last || (scan->end == SegmentScan::End::kClean && scan->next_index == std::next(it)->first))
      continue;
    // Records behind this place were synced before the next segment began: they were damaged, and
    // those of the next ones cannot follow.
    const std::string why = scan->why.empty()
                                ? absl::StrFormat("ends before record %d", std::next(it)->first)
                                : scan->why;
    // A gap that a snapshot covers is none.
    if (std::next(it)->first <= expected && std::next(it)->first <= after + 1) continue;
    if (!options_.recover_damaged) {
      return absl::DataLossError(absl::StrFormat("%s: %s", path, why));
    }
    std::lock_guard lock(mu_);
    repaired_ =
        absl::StrFormat("%s: %s; the log ends before it, the rest is kept as .damaged", path, why);
    if (absl::Status s = WriteFileSynced(path + ".damaged", *bytes); !s.ok()) return s;
    for (auto later = std::next(it); later != segments.end(); ++later) {
      const std::string old = PathOf(later->first);
      if (absl::Status s = RenameSynced(old, old + ".damaged"); !s.ok()) return s;
      segments_.erase(later->first);
    }
    return CutAt(it->first, scan->valid_bytes, scan->next_index);
  }
  return absl::OkStatus();
}

void SegmentLog::Forget(uint64_t index) {
  std::lock_guard lock(mu_);
  while (segments_.size() > 1 && std::next(segments_.begin())->first <= index + 1) {
    if (!RemoveAll(PathOf(segments_.begin()->first)).ok()) return;
    segments_.erase(segments_.begin());
  }
}

LogStats SegmentLog::Stats() const {
  std::lock_guard lock(mu_);
  LogStats stats = stats_;
  stats.first_index = segments_.begin()->first;
  stats.last_index = next_index_ - 1;
  stats.segments = segments_.size();
  for (const auto& [first, bytes] : segments_) stats.bytes += bytes;
  return stats;
}

}  // namespace clearance
