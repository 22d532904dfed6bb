#include "server/engine/recovery.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "server/engine/snapshotter.h"
#include "server/map/map_config_code.h"

namespace clearance {
namespace {

SourceLedger& LedgerOf(MapState& state, const std::string& source, size_t window) {
  return state.ledgers.try_emplace(source, window).first->second;
}

// As the mapping engine settled it.
void Settle(MapState& state, const std::string& source, uint64_t frame_id,
            std::optional<int64_t> stamp_ns, FrameAck::Status status, size_t window) {
  SourceLedger& ledger = LedgerOf(state, source, window);
  // A rejection that was logged late may be in the snapshot already.
  if (ledger.Judge(frame_id, INT64_MAX).kind != SourceLedger::Judgement::Kind::kNew) return;
  ledger.Admit(frame_id, stamp_ns);
  FrameAck ack;
  ack.frame_id = frame_id;
  ack.status = status;
  ack.stamp.revision = ack.stamp.field_revision = state.model->revision();
  if (stamp_ns) ack.stamp.stamp_ns = *stamp_ns;
  ack.stamp.published_at = std::chrono::steady_clock::now();
  ledger.Settle(ack);
}

absl::Status ApplyFrame(MapState& state, const LogRecord& record, const RecoveryOptions& options) {
  absl::StatusOr<Frame> frame = options.codec.decode(record.frame);
  if (!frame.ok()) {
    return absl::DataLossError(absl::StrFormat("a logged frame cannot be decoded: %s",
                                               std::string(frame.status().message())));
  }
  const bool stripped = record.kind == LogRecord::Kind::kStripped;
  if (stripped) frame->observation = std::monostate{};
  const bool integrated = state.model->Integrate(*frame).ok();
  const FrameAck::Status status = !integrated ? FrameAck::Status::kRejected
                                  : stripped  ? FrameAck::Status::kDropped
                                              : FrameAck::Status::kIntegrated;
  Settle(state, frame->source_id, frame->frame_id, frame->stamp_ns, status, options.settled_window);
  return absl::OkStatus();
}

absl::Status Apply(MapState& state, std::string_view bytes, const RecoveryOptions& options) {
  const absl::StatusOr<LogRecord> record = DecodeRecord(bytes);
  if (!record.ok()) return record.status();
  switch (record->kind) {
    case LogRecord::Kind::kFrame:
    case LogRecord::Kind::kStripped:
      return ApplyFrame(state, *record, options);
    case LogRecord::Kind::kRejected:
      Settle(state, record->source_id, record->frame_id, std::nullopt, FrameAck::Status::kRejected,
             options.settled_window);
      return absl::OkStatus();
    case LogRecord::Kind::kEdit:
      return state.model->Edit(record->edit).status();
    case LogRecord::Kind::kEviction:
      state.model->Evict(record->eviction);
      return absl::OkStatus();
  }
  return absl::OkStatus();
}

absl::StatusOr<MapState> EmptyState(const MapFolder& folder, const RecoveryOptions& options) {
  const absl::StatusOr<MapConfig> config = DecodeMapConfig(folder.config());
  if (!config.ok()) return config.status();
  MapState state;
  state.config = *config;
  state.model = options.model(*config);
  return state;
}

// The newest state that is whole and that the log continues.
absl::StatusOr<MapState> FindStart(const MapFolder& folder, const RecoveryOptions& options,
                                   std::vector<std::string>* notes) {
  const uint64_t first = folder.log()->Stats().first_index;
  std::vector<std::string> damaged;
  folder.Snapshots(&damaged);
  for (const std::string& id : damaged) {
    notes->push_back(absl::StrFormat("map %s: snapshot %s cannot be read: %s", folder.map(), id,
                                     std::string(folder.FindSnapshot(id).status().message())));
  }
  for (const SnapshotManifest& manifest : folder.RecoverySnapshots()) {
    if (manifest.log_index + 1 < first) break;  // older ones even more so
    absl::StatusOr<MapState> state = LoadSnapshot(folder, manifest, options);
    if (state.ok()) {
      state->log_index = manifest.log_index;
      return state;
    }
    notes->push_back(absl::StrFormat("map %s: snapshot %s is passed over: %s", folder.map(),
                                     manifest.snapshot_id, std::string(state.status().message())));
  }
  if (first == 1 && folder.base_snapshot().empty()) return EmptyState(folder, options);
  return absl::DataLossError(absl::StrFormat(
      "map '%s' cannot be recovered: its log starts at record %d%s, and no snapshot that it "
      "continues is whole. %s",
      folder.map(), first,
      folder.base_snapshot().empty() ? "" : " behind snapshot '" + folder.base_snapshot() + "'",
      notes->empty() ? "" : notes->back()));
}

}  // namespace

std::string EncodeLedgers(const std::map<std::string, SourceLedger>& ledgers) {
  ByteWriter out;
  out.Put<uint64_t>(ledgers.size());
  for (const auto& [source, ledger] : ledgers) {
    out.PutText(source);
    ledger.Save(&out);
  }
  return out.Take();
}

absl::StatusOr<MapState> LoadSnapshot(const MapFolder& folder, const SnapshotManifest& manifest,
                                      const RecoveryOptions& options) {
  const FileSource files = [&](std::string_view name) {
    return ReadSnapshotFile(folder.SnapshotFolder(manifest.snapshot_id), manifest, name);
  };
  const absl::StatusOr<MapConfig> config = DecodeMapConfig(manifest.config);
  if (!config.ok()) return config.status();
  const absl::StatusOr<std::string> ledgers = files(kLedgersFile);
  if (!ledgers.ok()) return ledgers.status();
  MapState state;
  state.config = *config;
  ByteReader in(*ledgers, kLedgersFile);
  for (size_t left = in.GetCount(1); left > 0 && in.ok(); --left) {
    std::string source(in.GetText());
    state.ledgers.emplace(std::move(source), SourceLedger::Load(&in, options.settled_window));
  }
  if (absl::Status s = in.Finish(); !s.ok()) return s;
  absl::StatusOr<std::unique_ptr<MapModel>> model = options.load(*config, files);
  if (!model.ok()) return model.status();
  state.model = *std::move(model);
  if (state.model->revision() != manifest.revision) {
    return absl::DataLossError(absl::StrFormat("the snapshot's state is of revision %d, not %d",
                                               state.model->revision(), manifest.revision));
  }
  return state;
}

absl::StatusOr<MapState> RecoverMap(MapFolder& folder, const RecoveryOptions& options,
                                    std::vector<std::string>* notes) {
  const std::shared_ptr<SegmentLog> log = folder.log();
  absl::StatusOr<MapState> state = FindStart(folder, options, notes);
  if (!state.ok()) return state;
  const absl::Status replayed =
      log->Replay(state->log_index, [&](uint64_t index, std::string_view record) {
        state->log_index = index;
        return Apply(*state, record, options);
      });
  if (!log->repaired().empty()) notes->push_back(log->repaired());
  if (!replayed.ok()) {
    return absl::Status(replayed.code(), absl::StrFormat("map '%s': %s", folder.map(),
                                                         std::string(replayed.message())));
  }
  // Records that a crash of the machine took from the log may still be in the snapshot.
  if (absl::Status s = log->SkipTo(state->log_index + 1); !s.ok()) return s;
  return state;
}

}  // namespace clearance
