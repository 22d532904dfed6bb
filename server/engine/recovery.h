// A map's way back from disk: a snapshot, and the log behind it.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/engine/log_record.h"
#include "server/engine/source_ledger.h"
#include "server/store/map_folder.h"

namespace clearance {

// What an engine begins with.
struct MapState {
  MapConfig config;
  std::unique_ptr<MapModel> model;
  std::map<std::string, SourceLedger> ledgers;  // by source
  uint64_t log_index = 0;                       // newest record that is in the model
};

struct RecoveryOptions {
  MapModelFactory model;
  MapModelLoader load;
  FrameCodec codec;
  size_t settled_window = 4096;
};

std::string EncodeLedgers(const std::map<std::string, SourceLedger>& ledgers);

// Every file is checked before anything of it is used. DATA_LOSS where one is damaged.
absl::StatusOr<MapState> LoadSnapshot(const MapFolder& folder, const SnapshotManifest& manifest,
                                      const RecoveryOptions& options);

// The newest snapshot that is whole, and all records behind it. Never silently less: DATA_LOSS
// where neither a snapshot nor the log's beginning is there, or where the log is damaged. What had
// to be passed over is told in `notes`.
absl::StatusOr<MapState> RecoverMap(MapFolder& folder, const RecoveryOptions& options,
                                    std::vector<std::string>* notes);

}  // namespace clearance
