#include "server/engine/mapping_engine.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/engine/background_priority.h"

namespace clearance {
namespace {

uint64_t ResidentBytes() {
  uint64_t pages = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

double MsBetween(std::chrono::steady_clock::time_point from,
                 std::chrono::steady_clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

// Without work for this long, memory that a burst of frames needed goes back to the system.
constexpr std::chrono::milliseconds kRestAfter{500};

FrameAck AckOf(uint64_t frame_id, FrameAck::Status status, const RevisionStamp& stamp) {
  FrameAck ack;
  ack.frame_id = frame_id;
  ack.status = status;
  ack.stamp = stamp;
  return ack;
}

}  // namespace

MappingEngine::MappingEngine(std::string id, const MapConfig& config,
                             std::unique_ptr<MapModel> model, uint64_t epoch, TimerQueue* timers,
                             EngineOptions options)
    : MappingEngine(std::move(id), MapState{config, std::move(model), {}, 0}, nullptr, epoch,
                    timers, std::move(options)) {}

MappingEngine::MappingEngine(std::string id, MapState start, std::shared_ptr<MapFolder> folder,
                             uint64_t epoch, TimerQueue* timers, EngineOptions options)
    : id_(std::move(id)),
      config_(start.config),
      epoch_(epoch),
      options_(std::move(options)),
      folder_(std::move(folder)),
      log_(folder_ ? folder_->log() : nullptr),
      model_(std::move(start.model)),
      log_index_(start.log_index),
      queue_({options_.queue_frames, options_.queue_stripped_frames, config_.overload}),
      ledgers_(std::move(start.ledgers)) {
  MapView first = model_->View();
  first.config = config_;
  first.epoch = epoch_;
  first.published_at = Clock::now();
  store_ = std::make_shared<MapStore>(std::make_shared<const MapView>(std::move(first)), timers,
                                      options_.kept_revisions);
  MutexLock lock(&join_mu_);
  thread_ = std::thread([this] { Run(); });
}

MappingEngine::~MappingEngine() { Stop(); }

SourceLedger& MappingEngine::LedgerOf(const std::string& source_id) {
  return ledgers_.try_emplace(source_id, options_.settled_window).first->second;
}

Admission MappingEngine::Submit(Frame&& frame, FrameCallback done, std::string* encoded) {
  const RevisionStamp now = StampOf(*Latest());
  std::optional<FrameAck> at_once;
  {
    MutexLock lock(&mu_);
    if (stopping_ || draining_) return Admission::kStopped;
    SourceLedger& ledger = LedgerOf(frame.source_id);
    const SourceLedger::Judgement judged = ledger.Judge(frame.frame_id, frame.stamp_ns);
    using Kind = SourceLedger::Judgement::Kind;
    switch (judged.kind) {
      case Kind::kPending:
        ledger.AddRepeat(frame.frame_id, std::move(done));
        return Admission::kTaken;
      case Kind::kSettled:
        ledger.CountDuplicate();
        at_once = AckOf(frame.frame_id, FrameAck::Status::kDuplicate, judged.stamp);
        break;
      case Kind::kRefused:
        at_once = AckOf(frame.frame_id, FrameAck::Status::kRejected, now);
        at_once->violations.push_back(judged.violation);
        break;
      case Kind::kNew: {
        QueuedFrame item;
        if (!judged.violation.field.empty()) item.rejections.push_back(judged.violation);
        const bool has_points =
            item.rejections.empty() && !std::holds_alternative<std::monostate>(frame.observation);
        if (!over_memory_.empty()) {
          // Look again: another map may have gone meanwhile.
          if (tasks_.empty()) tasks_.push_back([](MapModel*, const ViewPtr&) {});
          changed_.NotifyAll();
          return Admission::kOverMemory;
        }
        if (!queue_.HasRoom(has_points)) return Admission::kFull;
        if (encoded != nullptr && log_) item.encoded = std::move(*encoded);
        item.frame = std::move(frame);
        item.done = std::move(done);
        return Enqueue(std::move(item), ledger);
      }
    }
  }
  done(*at_once);
  return Admission::kTaken;
}

Admission MappingEngine::SubmitRejected(const std::string& source_id, uint64_t frame_id,
                                        std::vector<Violation> violations, FrameCallback done) {
  const RevisionStamp now = StampOf(*Latest());
  {
    MutexLock lock(&mu_);
    if (stopping_ || draining_) return Admission::kStopped;
    SourceLedger& ledger = LedgerOf(source_id);
    if (ledger.Judge(frame_id, INT64_MAX).kind == SourceLedger::Judgement::Kind::kNew) {
      if (!queue_.HasRoom(false)) return Admission::kFull;
      QueuedFrame item;
      item.frame.source_id = source_id;
      item.frame.frame_id = frame_id;
      item.rejections = std::move(violations);
      item.done = std::move(done);
      return Enqueue(std::move(item), ledger);
    }
  }
  // Its id is not new: nothing to settle.
  FrameAck ack = AckOf(frame_id, FrameAck::Status::kRejected, now);
  ack.violations = std::move(violations);
  done(ack);
  return Admission::kTaken;
}

Admission MappingEngine::Enqueue(QueuedFrame item, SourceLedger& ledger) {
  std::optional<int64_t> stamp_ns;
  if (item.rejections.empty()) stamp_ns = item.frame.stamp_ns;
  ledger.Admit(item.frame.frame_id, stamp_ns);
  item.queued_at = Clock::now();
  queue_.Push(std::move(item));
  changed_.NotifyAll();
  return Admission::kTaken;
}

void MappingEngine::NotifyRoom(std::function<void()> room) {
  {
    MutexLock lock(&mu_);
    if (!queue_.HasRoom(true) && !stopping_ && !draining_) {
      room_.push_back(std::move(room));
      return;
    }
  }
  room();
}

absl::Status MappingEngine::Post(Task task) {
  MutexLock lock(&mu_);
  if (stopping_) return absl::UnavailableError(absl::StrCat("map '", id_, "' is stopping"));
  if (tasks_.size() >= options_.queue_tasks) {
    return absl::ResourceExhaustedError(absl::StrCat("map '", id_, "': ", tasks_.size(),
                                                     " edits and exports wait already; try again"));
  }
  tasks_.push_back(std::move(task));
  changed_.NotifyAll();
  return absl::OkStatus();
}

absl::Status MappingEngine::EditRegion(const RegionEdit& edit, EditCallback done) {
  return Post([this, edit, done = std::move(done)](MapModel* model, const ViewPtr& view) {
    if (model == nullptr) {
      done(absl::UnavailableError(absl::StrCat("map '", id_, "' is stopping")), {});
      return;
    }
    LogRecord record;
    record.kind = LogRecord::Kind::kEdit;
    record.edit = edit;
    if (absl::Status s = AppendToLog(record); !s.ok()) return done(std::move(s), StampOf(*view));
    absl::StatusOr<MapModel::Edited> edited = model->Edit(edit);
    const ViewPtr after = edited.ok() ? Publish(false) : view;
    done(std::move(edited), StampOf(*after));
  });
}

void MappingEngine::Run() {
  const BackgroundPriority background;
  RefreshSizes(true);
  Clock::time_point worked_at = Clock::now();
  bool rested = true;
  mu_.Lock();
  while (true) {
    if (stopping_) break;
    if (!tasks_.empty()) {
      std::vector<Task> tasks;
      tasks.swap(tasks_);
      busy_ = true;
      mu_.Unlock();
      for (Task& task : tasks) task(model_.get(), Latest());
      tasks.clear();
      RefreshSizes(false);
      worked_at = Clock::now();
      rested = false;
      mu_.Lock();
      busy_ = false;
      changed_.NotifyAll();
      continue;
    }
    std::optional<QueuedFrame> item = queue_.Pop();
    if (!item) {
      const Clock::time_point rest_at = worked_at + kRestAfter;
      if (rested) {
        changed_.Wait(&mu_);
      } else if (Clock::now() < rest_at) {
        changed_.WaitUntil(&mu_, rest_at);
      } else {
        rested = true;
        mu_.Unlock();
        malloc_trim(0);  // freed frames and replaced blocks lie between what stays
        RefreshSizes(true);
        mu_.Lock();
      }
      continue;
    }
    busy_ = true;
    std::vector<std::function<void()>> room;
    if (queue_.HasRoom(true)) room.swap(room_);
    mu_.Unlock();
    for (const auto& notify : room) notify();
    RunFrame(std::move(*item));
    worked_at = Clock::now();
    rested = false;
    mu_.Lock();
    busy_ = false;
    changed_.NotifyAll();
  }
  mu_.Unlock();
  AbandonAll();
}

void MappingEngine::RunFrame(QueuedFrame item) {
  const Clock::time_point started = Clock::now();
  FrameAck ack = AckOf(item.frame.frame_id, FrameAck::Status::kRejected, StampOf(*Latest()));
  ack.queue_ms = MsBetween(item.queued_at, started);
  ack.violations = std::move(item.rejections);
  if (!ack.violations.empty()) {
    LogRejected(item);
    return Settle(item, std::move(ack));
  }
  if (log_) {
    if (const absl::Status logged = LogFrame(item); !logged.ok()) {
      ack.violations.push_back(
          {"log", -1, "the frame could not be logged: " + std::string(logged.message())});
      LogRejected(item);
      return Settle(item, std::move(ack));
    }
    if (!item.stripped) {
      item.done(AckOf(item.frame.frame_id, FrameAck::Status::kAccepted, ack.stamp));
    }
  }
  if (options_.before_integrate) options_.before_integrate(item.frame);
  absl::StatusOr<MapModel::Integrated> integrated = model_->Integrate(item.frame);
  if (!integrated.ok()) {
    ack.violations.push_back({"frame", -1, std::string(integrated.status().message())});
    return Settle(item, std::move(ack));
  }
  const Clock::time_point publishing = Clock::now();
  ack.stamp = StampOf(*Publish(true));
  integrated->stages.emplace_back("publish", MsBetween(publishing, Clock::now()));
  ack.status = item.stripped ? FrameAck::Status::kDropped : FrameAck::Status::kIntegrated;
  ack.violations = std::move(integrated->violations);
  ack.integrate_ms = MsBetween(started, Clock::now());
  integrated->stages.emplace_back("queue", ack.queue_ms);
  integrated->stages.emplace_back("total", ack.integrate_ms);
  RecordStages(integrated->stages);
  Settle(item, std::move(ack));
  RefreshSizes(false);
}

absl::Status MappingEngine::AppendToLog(const LogRecord& record, std::string_view body) {
  if (!log_) return absl::OkStatus();
  while (!unlogged_.empty()) {
    const absl::StatusOr<uint64_t> index = log_->Append(EncodeHead(unlogged_.front()), {});
    if (!index.ok()) return index.status();
    log_index_ = *index;
    unlogged_.pop_front();
  }
  const absl::StatusOr<uint64_t> index = log_->Append(EncodeHead(record), body);
  if (index.ok()) log_index_ = *index;
  return index.status();
}

absl::Status MappingEngine::LogFrame(const QueuedFrame& item) {
  LogRecord record;
  if (item.encoded.empty()) return absl::InternalError("it came without its encoding");
  if (!item.stripped) return AppendToLog(record, item.encoded);
  record.kind = LogRecord::Kind::kStripped;
  const absl::StatusOr<std::string> rest = options_.codec.without_points(item.encoded);
  return rest.ok() ? AppendToLog(record, *rest) : rest.status();
}

void MappingEngine::LogRejected(const QueuedFrame& item) {
  if (!log_) return;
  LogRecord record;
  record.kind = LogRecord::Kind::kRejected;
  record.source_id = item.frame.source_id;
  record.frame_id = item.frame.frame_id;
  if (AppendToLog(record).ok()) return;
  // Without room: after a crash the client would only be told to send it again.
  unlogged_.push_back(std::move(record));
  if (unlogged_.size() > options_.settled_window) unlogged_.pop_front();
}

absl::Status MappingEngine::Freeze(std::function<void(absl::StatusOr<Frozen>)> done) {
  return Post([this, done = std::move(done)](MapModel* model, const ViewPtr& view) {
    if (model == nullptr) {
      return done(absl::UnavailableError(absl::StrCat("map '", id_, "' is stopping")));
    }
    Frozen frozen;
    frozen.model = model->Freeze();
    frozen.stamp = StampOf(*view);
    frozen.log_index = log_index_;
    if (folder_) frozen.lineage = folder_->lineage();
    {
      MutexLock lock(&mu_);
      frozen.ledgers = EncodeLedgers(ledgers_);
    }
    done(std::move(frozen));
  });
}

void MappingEngine::Settle(const QueuedFrame& item, FrameAck ack) {
  std::vector<FrameCallback> repeats;
  {
    MutexLock lock(&mu_);
    SourceLedger& ledger = LedgerOf(item.frame.source_id);
    repeats = ledger.Settle(ack);
    for (size_t i = 0; i < repeats.size(); ++i) ledger.CountDuplicate();
  }
  item.done(ack);
  ack.status = FrameAck::Status::kDuplicate;
  for (const FrameCallback& repeat : repeats) repeat(ack);
}

ViewPtr MappingEngine::Publish(bool new_frame) {
  auto view = std::make_shared<MapView>(model_->View());
  view->config = config_;
  view->epoch = epoch_;
  // An edit makes nothing fresher: staleness counts from the newest frame.
  view->published_at = new_frame ? Clock::now() : Latest()->published_at;
  ViewPtr shared = std::move(view);
  store_->Publish(shared);
  return shared;
}

void MappingEngine::RecordStages(const StageTimes& stages) {
  MutexLock lock(&mu_);
  for (const auto& [name, ms] : stages) stages_[name].Add(ms);
}

void MappingEngine::RefreshSizes(bool force) {
  // Sizes cost time that grows with the map, so they are taken by the clock, not by the frame, and
  // the more rarely the longer they take: no more than a fiftieth of the thread's time.
  const Clock::time_point now = Clock::now();
  // A map that had seen nothing is measured with its first frame: it is small.
  if (!force && observed_ && now < sizes_at_) return;
  MapSizes sizes = model_->Sizes();
  observed_ = sizes.observed_W.has_value();
  sizes_at_ = now + std::max<Clock::duration>(options_.sizes_period, 50 * (Clock::now() - now));
  {
    MutexLock lock(&mu_);
    sizes_ = std::move(sizes);
  }
  RelieveMemory();
}

void MappingEngine::RelieveMemory() {
  constexpr double kKeep = 0.8;  // of the blocks, at one eviction
  const auto over = [this]() -> std::string {
    const uint64_t own = config_.memory_cap_bytes, all = options_.process_memory_cap_bytes;
    MutexLock lock(&mu_);
    if (own > 0 && sizes_.memory_bytes > own) {
      return absl::StrCat("map '", id_, "' takes ", sizes_.memory_bytes, " bytes, limit ", own);
    }
    const uint64_t used = all == 0                        ? 0
                          : options_.process_memory_bytes ? options_.process_memory_bytes()
                                                          : ResidentBytes();
    if (used > all) return absl::StrCat("the server takes ", used, " bytes, limit ", all);
    return "";
  };
  std::string reason = over();
  if (!reason.empty() && options_.evict_over_cap) {
    LogRecord record;
    record.kind = LogRecord::Kind::kEviction;
    const std::optional<MapModel::Eviction> eviction = model_->ChooseEviction(kKeep);
    if (eviction) record.eviction = *eviction;
    if (eviction && AppendToLog(record).ok()) {
      model_->Evict(*eviction);
      malloc_trim(0);
      Publish(false);
      MapSizes sizes = model_->Sizes();
      {
        MutexLock lock(&mu_);
        sizes_ = std::move(sizes);
        ++evictions_;
      }
      reason = over();
    }
  }
  MutexLock lock(&mu_);
  over_memory_ = std::move(reason);
}

std::optional<uint64_t> MappingEngine::LastSettledId(const std::string& source_id) const {
  MutexLock lock(&mu_);
  const auto it = ledgers_.find(source_id);
  return it == ledgers_.end() ? std::nullopt : it->second.last_settled_id();
}

EngineStats MappingEngine::Stats() const {
  MutexLock lock(&mu_);
  EngineStats stats;
  stats.queue_length = queue_.size();
  stats.queue_capacity = queue_.capacity();
  stats.sizes = sizes_;
  for (const auto& [id, ledger] : ledgers_) {
    stats.sources.push_back({id, ledger.last_settled_id(), ledger.last_stamp_ns(),
                             ledger.integrated(), ledger.dropped(), ledger.rejected(),
                             ledger.duplicate()});
  }
  stats.over_memory = over_memory_;
  stats.evictions = evictions_;
  if (log_) stats.log = log_->Stats();
  for (const auto& [name, histogram] : stages_) {
    stats.stages.emplace_back(name, histogram.Summary());
  }
  return stats;
}

bool MappingEngine::Drain(Clock::time_point deadline) {
  std::vector<std::function<void()>> room;
  bool drained = true;
  {
    MutexLock lock(&mu_);
    draining_ = true;
    room.swap(room_);
    while (!stopping_ && (busy_ || queue_.size() > 0 || !tasks_.empty())) {
      if (!changed_.WaitUntil(&mu_, deadline) && Clock::now() >= deadline) {
        drained = false;
        break;
      }
    }
  }
  for (const auto& notify : room) notify();
  return drained;
}

void MappingEngine::Stop() {
  {
    MutexLock lock(&mu_);
    stopping_ = true;
    changed_.NotifyAll();
  }
  store_->Close(absl::UnavailableError(absl::StrCat("map '", id_, "' is stopping")));
  MutexLock lock(&join_mu_);
  if (thread_.joinable()) thread_.join();
}

MapState MappingEngine::TakeState() {
  MutexLock lock(&mu_);
  return {config_, std::move(model_), std::move(ledgers_), log_index_};
}

void MappingEngine::AbandonAll() {
  std::vector<std::pair<FrameCallback, FrameAck>> abandoned;
  std::vector<Task> tasks;
  std::vector<std::function<void()>> room;
  const RevisionStamp now = StampOf(*Latest());
  {
    MutexLock lock(&mu_);
    tasks.swap(tasks_);
    room.swap(room_);
    while (std::optional<QueuedFrame> item = queue_.Pop()) {
      const uint64_t frame_id = item->frame.frame_id;
      const FrameAck ack = AckOf(frame_id, FrameAck::Status::kAbandoned, now);
      abandoned.emplace_back(std::move(item->done), ack);
      for (FrameCallback& repeat : LedgerOf(item->frame.source_id).Abandon(frame_id)) {
        abandoned.emplace_back(std::move(repeat), ack);
      }
    }
  }
  for (const auto& [done, ack] : abandoned) done(ack);
  for (const Task& task : tasks) task(nullptr, nullptr);
  for (const auto& notify : room) notify();
}

}  // namespace clearance
