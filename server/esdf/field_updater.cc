#include "server/esdf/field_updater.h"

#include <tbb/parallel_for.h>

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>

#include "server/esdf/site_references.h"
#include "server/esdf/sweep.h"
#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

class Stopwatch {
 public:
  // Milliseconds since the last lap.
  double Lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

size_t CountBits(const BlockMask& mask) {
  size_t count = 0;
  for (uint64_t word : mask) count += static_cast<size_t>(__builtin_popcountll(word));
  return count;
}

BlockIndex Moved(const BlockIndex& b, int direction) {
  return {b.x + direction / 9 - 1, b.y + direction / 3 % 3 - 1, b.z + direction % 3 - 1};
}

// Whether any voxel's state differs. The sign of an unknown voxel belongs to its site.
bool StatesDiffer(const BlockRecord& record, const std::array<uint8_t, kBlockVoxels>& states) {
  int differs = 0;
  if (!record.data) {
    for (int o = 0; o < kBlockVoxels; ++o) differs |= states[o] ^ record.tile;
    return differs != 0;
  }
  for (int o = 0; o < kBlockVoxels; ++o) {
    const int bits = record.data->voxels[o].attributes;
    differs |= (bits & (bits & kStateBits ? kVoxelBits : kVoxelBits & ~kNegativeBit)) ^ states[o];
  }
  return differs != 0;
}

// Voxels that are not alike; `same_sites`: none of them differs in its site.
BlockMask DifferingVoxels(const FieldBlock& a, const FieldBlock& b, bool* same_sites) {
  constexpr uint64_t kSite = 0x0000ffffffffffffull | uint64_t{kSiteBits} << 48;
  BlockMask differs{};
#if defined(__AVX2__)
  static_assert(sizeof(FieldVoxel) == 8);
  __m256i all = _mm256_setzero_si256();
  for (int o = 0; o < kBlockVoxels; o += 4) {
    const __m256i x = _mm256_load_si256(reinterpret_cast<const __m256i*>(&a.voxels[o]));
    const __m256i y = _mm256_load_si256(reinterpret_cast<const __m256i*>(&b.voxels[o]));
    const __m256i same = _mm256_cmpeq_epi64(x, y);
    all = _mm256_or_si256(all, _mm256_xor_si256(x, y));
    const int bits = _mm256_movemask_pd(_mm256_castsi256_pd(same)) ^ 15;
    differs[o >> 6] |= static_cast<uint64_t>(bits) << (o & 63);
  }
  *same_sites = _mm256_testz_si256(all, _mm256_set1_epi64x(static_cast<int64_t>(kSite))) != 0;
#else
  uint64_t all = 0;
  for (int o = 0; o < kBlockVoxels; ++o) {
    const uint64_t d = std::bit_cast<uint64_t>(a.voxels[o]) ^ std::bit_cast<uint64_t>(b.voxels[o]);
    all |= d;
    differs[o >> 6] |= uint64_t{d != 0} << (o & 63);
  }
  *same_sites = (all & kSite) == 0;
#endif
  return differs;
}

}  // namespace

FieldUpdater::FieldUpdater(const MapConfig& config, const FusionOptions& fusion)
    : voxel_size_m_(config.voxel_size_m),
      min_weight_(fusion.min_weight),
      squared_limit_(SquaredLimit(config.max_distance_m, config.voxel_size_m)),
      squared_inside_(
          SquaredLimit(std::min(kUnseenInsideDepth_m, config.max_distance_m), config.voxel_size_m)),
      field_(config.voxel_size_m, config.max_distance_m) {
  for (int code = 0; code < 128; ++code) normals_[code] = NormalOfCode(code);
}

DistanceField FieldUpdater::Update(const SurfaceMap& map,
                                   absl::Span<const BlockIndex> changed_blocks) {
  stats_ = {};
  Stopwatch watch;
  table_.Begin();
  Extract(map, changed_blocks);
  stats_.extract_ms = watch.Lap();
  const std::vector<int32_t> repaired = RepairReferrers();
  stats_.repair_ms = watch.Lap();
  const std::vector<SeedTask> tasks = SeedTasks(repaired);
  Seed(tasks);
  stats_.seed_ms = watch.Lap();
  Propagate(tasks);
  stats_.sweep_ms = watch.Lap();
  Finish();
  Publish();
  stats_.finish_ms = watch.Lap();
  return field_;
}

void FieldUpdater::Extract(const SurfaceMap& map, absl::Span<const BlockIndex> changed_blocks) {
  changed_sites_.clear();
  retiled_.clear();
  const uint32_t now = table_.update();
  std::vector<int32_t> ids;
  for (const BlockIndex& b : changed_blocks) {
    const int32_t id = table_.FindOrCreate(b);
    if (table_[id].extracted_in == now) continue;
    table_[id].extracted_in = now;
    ids.push_back(id);
  }
  // Neighbours look one voxel into the changed blocks; theirs look into what did not change.
  ExtractBlocks(map, ExtractBlocks(map, ids));
}

// Returns the neighbours that are concerned and were not read in this update yet.
std::vector<int32_t> FieldUpdater::ExtractBlocks(const SurfaceMap& map,
                                                 const std::vector<int32_t>& ids) {
  stats_.extracted_blocks += ids.size();
  constexpr size_t kChunk = 512;
  std::vector<int32_t> concerned;
  extractions_.resize(std::max(extractions_.size(), std::min(kChunk, ids.size())));
  for (size_t begin = 0; begin < ids.size(); begin += kChunk) {
    const size_t count = std::min(kChunk, ids.size() - begin);
    tbb::parallel_for(size_t{0}, count, [&](size_t i) {
      Extraction& e = extractions_[i];
      e.id = ids[begin + i];
      ExtractBlock(map, table_[e.id].index, min_weight_, &e.block);
      const auto& states = e.block.states;
      e.new_states = StatesDiffer(table_[e.id], states);
      e.uniform = e.new_states && std::all_of(states.begin(), states.end(), [&](uint8_t state) {
                    return state == states[0] && (state & kNegativeBit) == 0;
                  });
    });
    for (size_t i = 0; i < count; ++i) {
      BlockRecord& record = table_[extractions_[i].id];
      const BlockShadow& shadow = extractions_[i].block.shadow;
      const uint32_t directions = ConcernedNeighbours(record.shadow, shadow);
      record.shadow = shadow;
      for (uint32_t bits = directions; bits; bits &= bits - 1) {
        const int32_t id = table_.Find(Moved(record.index, __builtin_ctz(bits)));
        if (id == kNoBlock || table_[id].extracted_in == table_.update()) continue;
        table_[id].extracted_in = table_.update();
        concerned.push_back(id);
      }
      MakeRoom(extractions_[i]);
    }
    tbb::parallel_for(size_t{0}, count, [&](size_t i) { Accept(extractions_[i]); });
    for (size_t i = 0; i < count; ++i) {
      const int32_t id = table_[extractions_[i].id].sites;
      if (id == kNoBlock || !sites_[id].changed()) continue;
      changed_sites_.push_back(id);
      stats_.fresh_sites += CountBits(sites_[id].fresh());
      stats_.gone_sites += CountBits(sites_[id].gone());
    }
  }
  return concerned;
}

// For what Accept() writes.
void FieldUpdater::MakeRoom(const Extraction& extraction) {
  BlockRecord& record = table_[extraction.id];
  if (extraction.new_states) {
    if (extraction.uniform && !record.data) {
      record.tile = extraction.block.states[0];
      retiled_.push_back(extraction.id);
    } else {
      table_.Prepare(extraction.id);
    }
  }
  if (record.sites == kNoBlock && extraction.block.sites.mask != BlockMask{}) {
    record.sites = static_cast<int32_t>(sites_.size());
    sites_.emplace_back(record.index);
  }
}

// One block by itself: any thread.
void FieldUpdater::Accept(const Extraction& extraction) {
  const BlockRecord& record = table_[extraction.id];
  if (extraction.new_states && record.data) {
    const auto& states = extraction.block.states;
    FieldBlock& block = table_.Fill(extraction.id);
    for (int o = 0; o < kBlockVoxels; ++o) {
      uint16_t& attributes = block.voxels[o].attributes;
      // Nothing known, as before: Finish() looks at the sign only where the site differs.
      const int keep = (attributes & kStateBits) == 0 && states[o] == 0 ? kNegativeBit : 0;
      attributes = (attributes & (kSiteBits | keep)) | states[o];
    }
  }
  if (record.sites != kNoBlock) sites_[record.sites].Update(extraction.block.sites);
}

std::vector<int32_t> FieldUpdater::RepairReferrers() {
  std::vector<int32_t> scanned;
  for (int32_t s : changed_sites_) {
    SiteBlock& sites = sites_[s];
    if (sites.gone() == BlockMask{}) continue;
    // The list may hold blocks that have long found other sites: drop those now.
    std::vector<int32_t> kept;
    for (int32_t id : sites.referrers) {
      BlockRecord& record = table_[id];
      if (!std::binary_search(record.references.begin(), record.references.end(), s)) continue;
      kept.push_back(id);
      if (record.scanned_in == table_.update()) continue;
      record.scanned_in = table_.update();
      scanned.push_back(id);
    }
    std::sort(kept.begin(), kept.end());
    kept.erase(std::unique(kept.begin(), kept.end()), kept.end());
    sites.referrers = std::move(kept);
  }
  stats_.scanned_blocks = scanned.size();
  const auto changed_for = [&](int32_t id) {
    ChangedSites changed;
    for (int32_t s : table_[id].references) {
      if (sites_[s].gone() != BlockMask{}) changed.push_back(&sites_[s]);
    }
    return changed;
  };
  std::vector<uint8_t> names_gone(scanned.size());
  tbb::parallel_for(size_t{0}, scanned.size(), [&](size_t i) {
    const BlockRecord& record = table_[scanned[i]];
    names_gone[i] =
        record.data && NamesGoneSite(record.index, *record.data, changed_for(scanned[i]));
  });
  std::vector<int32_t> repaired;
  for (size_t i = 0; i < scanned.size(); ++i) {
    if (names_gone[i]) repaired.push_back(scanned[i]);
  }
  stats_.repaired_blocks = repaired.size();
  for (int32_t id : repaired) table_.Prepare(id);
  tbb::parallel_for(size_t{0}, repaired.size(), [&](size_t i) {
    FollowSites(table_[repaired[i]].index, changed_for(repaired[i]), squared_limit_,
                &table_.Fill(repaired[i]));
  });
  return repaired;
}

std::vector<FieldUpdater::SeedTask> FieldUpdater::SeedTasks(const std::vector<int32_t>& repaired) {
  std::vector<SeedTask> tasks;
  for (int32_t id : repaired) {
    tasks.push_back({id, false});
    table_[id].queued = true;
  }
  for (int32_t s : changed_sites_) {
    for (int d = 0; d < 27; ++d) {
      if (!Intersects(sites_[s].fresh(), BorderMask(d))) continue;
      const int32_t id = table_.FindOrCreate(Moved(sites_[s].index(), d));
      if (table_[id].queued) continue;
      table_[id].queued = true;
      tasks.push_back({id, true});
    }
  }
  stats_.seeded_blocks = tasks.size();
  return tasks;
}

SiteNeighbourhood FieldUpdater::SitesAround(int32_t id) const {
  SiteNeighbourhood around{};
  for (int d = 0; d < 27; ++d) {
    const int32_t other = d == 13 ? id : table_.Find(Moved(table_[id].index, d));
    if (other == kNoBlock || table_[other].sites == kNoBlock) continue;
    around[d] = &sites_[table_[other].sites];
  }
  return around;
}

void FieldUpdater::Seed(const std::vector<SeedTask>& tasks) {
  for (const SeedTask& task : tasks) table_.Prepare(task.id);
  tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t i) {
    const SeedTask& task = tasks[i];
    SeedBlock(SitesAround(task.id), task.only_fresh, squared_limit_, &table_.Fill(task.id));
  });
}

void FieldUpdater::Propagate(const std::vector<SeedTask>& tasks) {
  // Red and black blocks take turns: a block reads only neighbours of the other colour, which stand
  // still meanwhile, so the outcome does not depend on who works first.
  const auto colour = [&](int32_t id) {
    const BlockIndex& b = table_[id].index;
    return (b.x + b.y + b.z) & 1;
  };
  std::array<std::vector<int32_t>, 2> work;
  for (const SeedTask& task : tasks) {
    work[colour(task.id)].push_back(task.id);
    table_[task.id].offered = kAllFaces;
  }
  std::vector<uint8_t> wake;
  for (int turn = 0; !work[0].empty() || !work[1].empty(); turn ^= 1) {
    const std::vector<int32_t> blocks = std::move(work[turn]);
    work[turn].clear();
    if (blocks.empty()) continue;
    ++stats_.rounds;
    stats_.swept_blocks += blocks.size();
    for (int32_t id : blocks) {
      table_[id].queued = false;
      table_.Prepare(id);
    }
    wake.assign(blocks.size(), 0);
    tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t i) {
      FieldBlock& block = table_.Fill(blocks[i]);
      std::array<const FieldBlock*, kFaces> neighbours{};
      for (int f = 0; f < kFaces; ++f) {
        const int32_t other = table_[blocks[i]].neighbour[f];
        if (other != kNoBlock) neighbours[f] = table_[other].data.get();
      }
      wake[i] = SweepBlock(neighbours, squared_limit_, &block, table_[blocks[i]].offered).wake;
    });
    for (size_t i = 0; i < blocks.size(); ++i) {
      table_[blocks[i]].offered = 0;
      for (int f = 0; f < kFaces; ++f) {
        if (!(wake[i] >> f & 1)) continue;
        const int32_t other = table_.Neighbour(blocks[i], f);
        table_[other].offered |= 1 << (f ^ 1);
        if (table_[other].queued) continue;
        table_[other].queued = true;
        work[turn ^ 1].push_back(other);
      }
    }
  }
}

inline bool FieldUpdater::LiesBehind(const FieldVoxel& v) const {
  const int32_t squared = SquaredUnits(v);
  if (squared > squared_inside_) return false;  // or no site at all
  // Behind: the way to the site leads along its normal, within 70 degrees. Beside the rim of a
  // surface it does not, and nothing is known there.
  constexpr float kBehindCosine = 0.35f;
  const Eigen::Vector3f& n = normals_[static_cast<size_t>(v.normal_code())];
  const float along = v.dx * n.x() + v.dy * n.y() + v.dz * n.z();
  return along > 0 && along * along > kBehindCosine * kBehindCosine * squared;
}

FieldUpdater::Outcome FieldUpdater::FinishBlock(int32_t id) {
  BlockRecord& record = table_[id];
  FieldBlock& block = *record.data;
  // Voxels that did not change keep the sign they have.
  BlockMask differs = kFullMask;
  Outcome out;
  if (record.replaced) {
    differs = DifferingVoxels(block, *record.replaced, &out.same_sites);
    out.same = true;
  }
  ForEachSet(differs, [&](int o) {
    FieldVoxel& v = block.voxels[o];
    if ((v.attributes & kStateBits) == 0) {
      v.attributes = (v.attributes & ~kNegativeBit) | (LiesBehind(v) ? kNegativeBit : 0);
    }
  });
  if (out.same && differs != BlockMask{}) {
    out.same = DifferingVoxels(block, *record.replaced, &out.same_sites) == BlockMask{};
  }
  if (out.same) return out;
  const FieldVoxel& first = block.voxels[0];
  out.uniform = !first.has_site() && std::all_of(block.voxels.begin(), block.voxels.end(),
                                                 [&](const FieldVoxel& v) { return v == first; });
  if (out.same_sites) return out;
  for (const BlockIndex& b : ReferencedBlocks(record.index, block)) {
    out.references.push_back(table_[table_.Find(b)].sites);
  }
  std::sort(out.references.begin(), out.references.end());
  return out;
}

void FieldUpdater::Finish() {
  const std::vector<int32_t>& written = table_.written();
  stats_.written_blocks = written.size();
  std::vector<Outcome> outcomes(written.size());
  tbb::parallel_for(size_t{0}, written.size(),
                    [&](size_t i) { outcomes[i] = FinishBlock(written[i]); });
  shown_.clear();
  for (size_t i = 0; i < written.size(); ++i) {
    const int32_t id = written[i];
    BlockRecord& record = table_[id];
    if (outcomes[i].same) {
      table_.TakeBack(id);
      continue;
    }
    table_.Commit(id);
    shown_.push_back(id);
    if (!outcomes[i].same_sites) {
      for (int32_t s : outcomes[i].references) {
        if (!std::binary_search(record.references.begin(), record.references.end(), s)) {
          sites_[s].referrers.push_back(id);
        }
      }
      record.references = std::move(outcomes[i].references);
    }
    if (outcomes[i].uniform) {
      table_.MakeUniform(id, record.data->voxels[0].attributes & kVoxelBits);
    }
  }
  stats_.shown_blocks = shown_.size();
  for (int32_t s : changed_sites_) sites_[s].Settle();
}

void FieldUpdater::PublishBlock(int32_t id) {
  const BlockRecord& record = table_[id];
  const uint8_t tile = record.data || record.tile == 0 ? DistanceField::kNoTile : record.tile & 7;
  field_.Set(record.index, record.data, tile);
}

void FieldUpdater::Publish() {
  for (int32_t id : shown_) PublishBlock(id);
  for (int32_t id : retiled_) PublishBlock(id);
}

uint64_t FieldUpdater::MemoryBytes() const {
  uint64_t bytes = table_.MemoryBytes();
  for (const SiteBlock& s : sites_) {
    bytes += sizeof(SiteBlock) + s.referrers.capacity() * sizeof(int32_t);
  }
  return bytes;
}

}  // namespace clearance
