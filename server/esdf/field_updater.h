// The incremental closest-site distance field of a map.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "server/esdf/block_extraction.h"
#include "server/esdf/block_table.h"
#include "server/esdf/seeding.h"
#include "server/esdf/site_extraction.h"
#include "server/esdf/site_table.h"
#include "server/map/distance_field.h"
#include "server/map/map_config.h"
#include "server/map/map_update.h"
#include "server/map/surface_map.h"

namespace clearance {

// Unknown voxels within this distance behind a surface count as its inside (negative distance):
// solids are seen from outside only. Farther behind, nothing is claimed.
inline constexpr double kUnseenInsideDepth_m = 1.0;

// Keeps a DistanceField up to date with a SurfaceMap: sites from the fused zero crossing, carried
// to max_distance_m through free and unknown space. One updater follows one map from its first
// frame. The work depends on what changed and on how far it reaches, not on the size of the map.
// The bytes depend on the sequence of updates alone, not on the number of threads.
// Essential state, between two updates: the records of the block table in the order of their ids
// (index, voxels or tile, site block, shadow, references) and the site table (index, mask, sites,
// referrers). Everything else follows from it or is scratch: ids and neighbour links, the pool, the
// returned field, the update counter and the marks that are compared with it.
// Not thread-safe; the fields it returns are immutable and may be read from any thread.
class FieldUpdater {
 public:
  // What the last Update() did, for statistics and tests.
  struct Stats {
    size_t extracted_blocks = 0;  // read from the map
    size_t fresh_sites = 0;       // new or moved
    size_t gone_sites = 0;        // moved or vanished
    size_t scanned_blocks = 0;    // looked at for gone sites
    size_t repaired_blocks = 0;   // ... and naming some
    size_t seeded_blocks = 0;
    size_t swept_blocks = 0;  // counted with repetition
    size_t rounds = 0;
    size_t written_blocks = 0;  // copied to be written ...
    size_t shown_blocks = 0;    // ... and new in the returned field
    double extract_ms = 0, repair_ms = 0, seed_ms = 0, sweep_ms = 0, finish_ms = 0;
  };

  // `config` must be valid (max_distance_m at most 120 voxels).
  FieldUpdater(const MapConfig& config, const FusionOptions& fusion);

  // `changed_blocks`: every block of `map` whose mean, weight or free class changed since the last
  // call (SurfaceMap::Apply), in any order. The result shares unchanged blocks with earlier
  // results.
  DistanceField Update(const SurfaceMap& map, absl::Span<const BlockIndex> changed_blocks);

  const Stats& stats() const { return stats_; }
  // The sites that the field is built from; the latest extraction may differ by ignored small
  // moves.
  const SiteTable& sites() const { return sites_; }
  // The result of the last Update().
  const DistanceField& field() const { return field_; }
  uint64_t MemoryBytes() const;
  // Gives memory that is kept for later updates back to the system.
  void ReleaseSpare() { table_.ReleaseSpare(); }

  // For snapshots, between two updates: what a new updater needs to go on exactly as this one.
  // `blocks` are shared and do not change any more.
  struct Saved {
    std::string table;
    std::vector<std::shared_ptr<const FieldBlock>> blocks;
  };
  Saved Save() const;
  // `blocks`: the voxels of the saved blocks, one after the other. DATA_LOSS for bytes that are
  // not those of an updater.
  static absl::StatusOr<FieldUpdater> Load(const MapConfig& config, const FusionOptions& fusion,
                                           std::string_view table, std::string_view blocks);

 private:
  struct Extraction {
    int32_t id = kNoBlock;
    bool new_states = false;
    bool uniform = false;  // the new states are one
    BlockExtraction block;
  };
  struct SeedTask {
    int32_t id;
    bool only_fresh;
  };

  void Extract(const SurfaceMap& map, absl::Span<const BlockIndex> changed_blocks);
  std::vector<int32_t> ExtractBlocks(const SurfaceMap& map, const std::vector<int32_t>& ids);
  void MakeRoom(const Extraction& extraction);
  void Accept(const Extraction& extraction);
  std::vector<int32_t> RepairReferrers();
  std::vector<SeedTask> SeedTasks(const std::vector<int32_t>& repaired);
  SiteNeighbourhood SitesAround(int32_t id) const;
  void Seed(const std::vector<SeedTask>& tasks);
  void Propagate(const std::vector<SeedTask>& tasks);
  void Finish();
  // What became of a written block.
  struct Outcome {
    bool same = false;     // as before
    bool uniform = false;  // no site, every voxel alike
    bool same_sites = false;
    absl::InlinedVector<int32_t, 8> references{};  // unless same_sites
  };
  Outcome FinishBlock(int32_t id);
  bool LiesBehind(const FieldVoxel& v) const;
  void PublishBlock(int32_t id);
  void Publish();

  double voxel_size_m_;
  float min_weight_;
  int32_t squared_limit_;
  int32_t squared_inside_;
  std::array<Eigen::Vector3f, 128> normals_;  // by code
  BlockTable table_;
  SiteTable sites_;
  std::vector<int32_t> changed_sites_;   // site blocks that this update changed
  std::vector<int32_t> retiled_;         // blocks whose tile this update changed
  std::vector<int32_t> shown_;           // written blocks that differ from what was published
  std::vector<Extraction> extractions_;  // reused memory
  DistanceField field_;
  Stats stats_;
};

}  // namespace clearance
