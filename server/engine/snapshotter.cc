#include "server/engine/snapshotter.h"

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/map/map_config_code.h"

namespace clearance {
namespace {

using Clock = std::chrono::steady_clock;

std::string NameBy(absl::Time now, bool automatic) {
  return absl::StrFormat(
      "%s-%s", automatic ? "auto" : "at",
      absl::AsciiStrToLower(absl::FormatTime("%Y%m%d-%H%M%E3S", now, absl::UTCTimeZone())));
}

std::string WithoutDots(std::string id) {
  std::replace(id.begin(), id.end(), '.', '-');
  return id;
}

}  // namespace

absl::Status ValidateSnapshotId(std::string_view id) {
  const bool good =
      !id.empty() && id.size() <= 63 && id[0] != '_' && id[0] != '-' &&
      std::all_of(id.begin(), id.end(), [](unsigned char c) {
        return absl::ascii_islower(c) || absl::ascii_isdigit(c) || c == '_' || c == '-';
      });
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "snapshot_id: got '%s', expected [a-z0-9][a-z0-9_-]{0,62}", id.substr(0, 80)));
}

Snapshotter::Snapshotter(Engines engines, const SnapshotOptions& options)
    : engines_(std::move(engines)), options_(options), thread_([this] { Run(); }) {}

Snapshotter::~Snapshotter() { Stop(); }

void Snapshotter::Stop() {
  std::deque<Job> left;
  {
    MutexLock lock(&mu_);
    stopping_ = true;
    left.swap(jobs_);
    changed_.NotifyAll();
  }
  for (Job& job : left) job.done(absl::UnavailableError("the server is stopping"));
  if (thread_.joinable()) thread_.join();
}

absl::Status Snapshotter::Create(const std::shared_ptr<MappingEngine>& engine,
                                 std::string snapshot_id, std::string comment, bool automatic,
                                 Done done) {
  const absl::Time now = absl::Now();
  if (snapshot_id.empty()) snapshot_id = WithoutDots(NameBy(now, automatic));
  if (absl::Status s = ValidateSnapshotId(snapshot_id); !s.ok()) return s;
  const std::shared_ptr<MapFolder>& folder = engine->folder();
  if (!folder) {
    return absl::FailedPreconditionError(
        "snapshots need a folder: set store.dir in the server's configuration");
  }
  const absl::Status known = folder->FindSnapshot(snapshot_id).status();
  if (!absl::IsNotFound(known)) {
    return absl::AlreadyExistsError(
        absl::StrFormat("snapshot '%s' of map '%s' exists already", snapshot_id, engine->id()));
  }
  {
    MutexLock lock(&mu_);
    if (stopping_) return absl::UnavailableError("the server is stopping");
    if (pending_ >= options_.queue) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("%d snapshots wait already; try again", pending_));
    }
    ++pending_;
  }
  Job job;
  job.engine = engine;
  job.done = std::move(done);
  job.manifest.map = engine->id();
  job.manifest.snapshot_id = std::move(snapshot_id);
  job.manifest.comment = std::move(comment);
  job.manifest.automatic = automatic;
  job.manifest.config = EncodeMapConfig(engine->config());
  job.manifest.created_unix_ns = absl::ToUnixNanos(now);
  auto shared = std::make_shared<Job>(std::move(job));
  absl::Status posted =
      engine->Freeze([this, shared](absl::StatusOr<MappingEngine::Frozen> frozen) {
        if (frozen.ok()) {
          shared->frozen = *std::move(frozen);
          return Enqueue(std::move(*shared));
        }
        {
          MutexLock lock(&mu_);
          --pending_;
        }
        shared->done(frozen.status());
      });
  if (!posted.ok()) {
    MutexLock lock(&mu_);
    --pending_;
  }
  return posted;
}

void Snapshotter::Enqueue(Job job) {
  {
    MutexLock lock(&mu_);
    if (!stopping_) {
      jobs_.push_back(std::move(job));
      changed_.NotifyAll();
      return;
    }
  }
  job.done(absl::UnavailableError("the server is stopping"));
}

absl::StatusOr<SnapshotManifest> Snapshotter::Write(Job& job) {
  const std::shared_ptr<MapFolder>& folder = job.engine->folder();
  SnapshotManifest& manifest = job.manifest;
  const RevisionStamp& stamp = job.frozen.stamp;
  manifest.epoch = stamp.epoch;
  manifest.revision = stamp.revision;
  manifest.field_revision = stamp.field_revision;
  manifest.stamp_ns = stamp.stamp_ns;
  manifest.lineage = job.frozen.lineage;
  manifest.log_index = job.frozen.log_index;
  // A snapshot is never ahead of its log.
  if (absl::Status s = folder->log()->Sync(); !s.ok()) return s;
  absl::StatusOr<SnapshotWriter> writer = folder->BeginSnapshot(manifest.snapshot_id);
  if (!writer.ok()) return writer.status();
  if (absl::Status s = writer->Add(kLedgersFile, job.frozen.ledgers); !s.ok()) return s;
  absl::Status written = job.frozen.model->Write(
      [&](std::string_view name, std::string bytes) { return writer->Add(name, bytes); });
  if (!written.ok()) return written;
  if (absl::Status s = writer->Commit(&manifest); !s.ok()) return s;
  folder->Prune(options_.keep);
  return manifest;
}

void Snapshotter::CreateDue() {
  for (const std::shared_ptr<MappingEngine>& engine : engines_()) {
    if (!engine->folder()) continue;
    const std::pair<uint64_t, uint64_t> now{engine->epoch(), engine->Latest()->revision};
    auto& newest = newest_[engine->id()];
    if (newest == now || now.second == 0) continue;
    newest = now;
    Create(engine, "", "", true, [](const absl::StatusOr<SnapshotManifest>&) {}).IgnoreError();
  }
}

void Snapshotter::Run() {
  Clock::time_point due = Clock::now() + options_.period;
  mu_.Lock();
  while (!stopping_) {
    if (!jobs_.empty()) {
      Job job = std::move(jobs_.front());
      jobs_.pop_front();
      mu_.Unlock();
      const Clock::time_point started = Clock::now();
      absl::StatusOr<SnapshotManifest> result = Write(job);
      const absl::Status status = result.status();
      job.done(std::move(result));
      job = {};  // the copy of the map goes before the next is made
      mu_.Lock();
      --pending_;
      status.ok() ? ++stats_.written : ++stats_.failed;
      if (!status.ok()) stats_.last_error = std::string(status.message());
      stats_.last_ms = std::chrono::duration<double, std::milli>(Clock::now() - started).count();
      continue;
    }
    if (options_.period.count() == 0) {
      changed_.Wait(&mu_);
    } else if (Clock::now() < due) {
      changed_.WaitUntil(&mu_, due);
    } else {
      due = Clock::now() + options_.period;
      mu_.Unlock();
      CreateDue();
      mu_.Lock();
    }
  }
  mu_.Unlock();
}

SnapshotterStats Snapshotter::Stats() const {
  MutexLock lock(&mu_);
  return stats_;
}

}  // namespace clearance
