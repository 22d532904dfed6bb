#include "server/map/surface_map.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "server/map/free_evidence.h"
#include "server/map/surface_grids.h"

namespace clearance {
namespace {

openvdb::Coord CoordOf(const BlockIndex& b) { return {b.x * 8, b.y * 8, b.z * 8}; }

openvdb::math::Transform::Ptr CellCentred(double h) {
  auto transform = openvdb::math::Transform::createLinearTransform(h);
  transform->postTranslate(openvdb::Vec3d(0.5 * h));
  return transform;
}

// What one frame does to one block; pointers into the update, or null.
struct BlockWork {
  BlockIndex block;
  const BandObservations::Block* band = nullptr;
  const FreeBlock* free = nullptr;
  const ReleasedBlock* released = nullptr;
  openvdb::FloatTree::LeafNodeType* mean = nullptr;
  openvdb::FloatTree::LeafNodeType* weight = nullptr;
  openvdb::Int32Tree::LeafNodeType* evidence = nullptr;
  bool changed = false;
  bool uniform_evidence = false;
};

std::vector<BlockWork> GatherWork(const SurfaceUpdate& update) {
  std::vector<BlockWork> work;
  work.reserve(update.band.blocks.size() + update.free.size() + update.released.size());
  size_t i = 0, j = 0, k = 0;
  const auto& band = update.band.blocks;
  while (i < band.size() || j < update.free.size() || k < update.released.size()) {
    BlockIndex next{INT32_MAX, INT32_MAX, INT32_MAX};
    if (i < band.size()) next = std::min(next, band[i].block);
    if (j < update.free.size()) next = std::min(next, update.free[j].block);
    if (k < update.released.size()) next = std::min(next, update.released[k].block);
    BlockWork w;
    w.block = next;
    if (i < band.size() && band[i].block == next) w.band = &band[i++];
    if (j < update.free.size() && update.free[j].block == next) w.free = &update.free[j++];
    if (k < update.released.size() && update.released[k].block == next) {
      w.released = &update.released[k++];
    }
    work.push_back(w);
  }
  return work;
}

constexpr float kHalfDiagonalVoxels = 0.9f;
// An observation of less weight lies a voxel or more from what was measured, ...
constexpr float kGuessWeight = 0.4f;
// ... and does not overrule rays that went through the voxel in so many frames.
constexpr uint8_t kFreeAgainstGuess = 3;

// Deeper behind a surface, observations are guesses.
constexpr float kSeenDepthVoxels = 0.5f;
// An observation in front of a surface of at least this weight overrules them.
constexpr float kSeenWeight = 0.4f;

uint8_t Increment(uint8_t count) { return count < kSaturatedFrames ? count + 1 : count; }

class BlockFuser {
 public:
  BlockFuser(const SurfaceUpdate& update, const FusionOptions& options, double voxel_size_m)
      : update_(update), options_(options), voxel_size_m_(static_cast<float>(voxel_size_m)) {}

  void Fuse(BlockWork& w) const {
    if (w.weight) {
      mean_ = w.mean->buffer().data();
      weight_ = w.weight->buffer().data();
    }
    if (w.evidence) evidence_ = w.evidence->buffer().data();
    if (w.released && w.weight) ForEach(w.released->voxels, [&](int o) { Release(w, o); });
    if (w.free) CountEvidence(w);
    if (w.band) FuseBand(w);
    if (w.evidence) FinishEvidence(w);
  }

 private:
  template <typename Fn>
  static void ForEach(const BlockMask& mask, const Fn& fn) {
    for (int word = 0; word < 8; ++word) {
      for (uint64_t bits = mask[word]; bits; bits &= bits - 1) {
        fn(word * 64 + __builtin_ctzll(bits));
      }
    }
  }

  void Forget(BlockWork& w, int o) const {
    if (weight_[o] == 0) return;
    weight_[o] = 0;
    mean_[o] = 0;
    w.mean->setValueOff(o);
    w.weight->setValueOff(o);
    w.changed = true;
  }

  // The returns were another's, too.
  void Release(BlockWork& w, int o) const {
    Forget(w, o);
    if (!evidence_ || evidence_[o] == 0) return;
    FreeEvidence e = FreeEvidence::Unpack(evidence_[o]);
    e.contradicted = e.returns = 0;
    evidence_[o] = e.Pack();
  }

  void CountEvidence(BlockWork& w) const {
    if (w.evidence) {
      ForEach(w.free->probable, [&](int o) {
        FreeEvidence e = FreeEvidence::Unpack(evidence_[o]);
        const bool was_free = IsFree(e), was_sure = e.confident >= FreeRules{}.min_confident_frames;
        e.probable = Increment(e.probable);
        if (Test(w.free->confident, o)) e.confident = Increment(e.confident);
        evidence_[o] = e.Pack();
        w.changed |=
            IsFree(e) != was_free || (e.confident >= FreeRules{}.min_confident_frames) != was_sure;
      });
      ForEach(w.free->hit, [&](int o) {
        FreeEvidence e = FreeEvidence::Unpack(evidence_[o]);
        w.changed |= evidence_[o] == 0;  // observed from now on
        e.returns = Increment(e.returns);
        e.contradicted = 0;
        evidence_[o] = e.Pack();
      });
    }
    if (w.weight) ForEach(w.free->contradicted, [&](int o) { Contradict(w, o); });
  }

  // Surface that rays went through is forgotten once it is refuted; until then the contradictions
  // in a row are counted.
  void Contradict(BlockWork& w, int o) const {
    if (weight_[o] == 0) return;
    FreeEvidence e = FreeEvidence::Unpack(evidence_[o]);
    e.contradicted = Increment(e.contradicted);
    if (Test(w.free->refuted, o)) {
      Forget(w, o);
      e.contradicted = 0;
      e.returns = 0;
    }
    evidence_[o] = e.Pack();
  }

  bool OverruledByRays(int o, float distance_m) const {
    if (weight_[o] >= kGuessWeight) return false;
    // Farther away is what those rays say, too.
    if (weight_[o] > 0 && distance_m > mean_[o]) return false;
    const FreeEvidence e = FreeEvidence::Unpack(evidence_[o]);
    return e.returns == 0 && e.probable >= kFreeAgainstGuess;
  }

  // Eq. (5) with an observation that says what is stored: only the weight grows, by the 1 - v of a
  // plane so far away. What lies deeper was never seen and grows no surer. Readers of the weight
  // (a site's sigma) are told when it reaches 4 and 16.
  void Confirm(BlockWork& w, int o) const {
    const float voxels = mean_[o] / voxel_size_m_;
    if (voxels < -kSeenDepthVoxels) return;
    const float before = weight_[o];
    weight_[o] = std::min(before + std::exp(-voxels * voxels), options_.max_weight);
    w.changed |= std::ilogb(weight_[o]) / 2 != std::ilogb(before) / 2;
  }

  void FuseBand(BlockWork& w) const {
    for (uint32_t i = w.band->begin; i < w.band->end; ++i) {
      const int o = update_.band.offset[i];
      const float d = update_.band.distance_m[i];
      float weight = update_.band.weight[i];
      if (weight == 0.f && weight_[o] == 0.f) weight = 1.f;  // confirmed, but just forgotten
      if (weight == 0.f) {
        Confirm(w, o);
      } else {
        if (w.evidence && weight < kGuessWeight && OverruledByRays(o, d)) continue;
        // What was seen in front of a surface is no guess, what is stored so deep behind one is.
        if (d > 0.f && weight >= kSeenWeight && mean_[o] < -kSeenDepthVoxels * voxel_size_m_) {
          weight_[o] = 0.f;
        }
        // Eq. (5): running weighted mean; the cap keeps old surface movable.
        mean_[o] = (weight_[o] * mean_[o] + weight * d) / (weight_[o] + weight);
        weight_[o] = std::min(weight_[o] + weight, options_.max_weight);
        if (!w.weight->isValueOn(o)) {
          w.mean->setValueOn(o);
          w.weight->setValueOn(o);
        }
        w.changed = true;
      }
      if (w.evidence && evidence_[o] != 0) {
        FreeEvidence e = FreeEvidence::Unpack(evidence_[o]);
        // Only surface in the cube confirms what is stored there, not the band in front of it.
        if (std::abs(d) < kHalfDiagonalVoxels * voxel_size_m_) e.contradicted = 0;
        if (d < 0) {  // seen behind a surface: what was free before has to prove it anew
          w.changed |= e.probable > 0;
          e.confident /= 2;
          e.probable /= 2;
        }
        evidence_[o] = e.Pack();
      }
    }
  }

  void FinishEvidence(BlockWork& w) const {
    w.uniform_evidence = true;
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (evidence_[o] != evidence_[0]) w.uniform_evidence = false;
      w.evidence->setActiveState(o, evidence_[o] != 0);
    }
  }

  const SurfaceUpdate& update_;
  const FusionOptions& options_;
  float voxel_size_m_;
  mutable float* mean_ = nullptr;
  mutable float* weight_ = nullptr;
  mutable int32_t* evidence_ = nullptr;
};

// Not registered with the tree, which costs more than the reads of one block: the tree stands still
// while this lives.
template <typename Tree>
using ReadAccessor = openvdb::tree::ValueAccessor<const Tree, false>;

// Copies a block and its halo out of a tree, leaf by leaf.
template <typename Tree, typename Value>
void ReadHalo(const Tree& tree, const BlockIndex& block, Value* out) {
  ReadAccessor<Tree> accessor(tree);
  for (int bx = -1; bx <= 1; ++bx) {
    const int x0 = bx < 0 ? -1 : bx * 8, x1 = bx < 0 ? 0 : (bx == 0 ? 8 : 9);
    for (int by = -1; by <= 1; ++by) {
      const int y0 = by < 0 ? -1 : by * 8, y1 = by < 0 ? 0 : (by == 0 ? 8 : 9);
      for (int bz = -1; bz <= 1; ++bz) {
        const int z0 = bz < 0 ? -1 : bz * 8, z1 = bz < 0 ? 0 : (bz == 0 ? 8 : 9);
        const openvdb::Coord ijk = CoordOf({block.x + bx, block.y + by, block.z + bz});
        const auto* leaf = accessor.probeConstLeaf(ijk);
        const Value tile = leaf ? Value{} : Value(accessor.getValue(ijk));
        const Value* data = leaf ? leaf->buffer().data() : nullptr;
        for (int x = x0; x < x1; ++x) {
          for (int y = y0; y < y1; ++y) {
            Value* row = out + HaloOffset(x, y, z0);
            if (!data) {
              std::fill(row, row + (z1 - z0), tile);
              continue;
            }
            const Value* from = data + (((x & 7) << 6) | ((y & 7) << 3) | (z0 & 7));
            if (bz == 0) {
              std::memcpy(row, from, kBlockSide * sizeof(Value));
            } else {
              *row = *from;
            }
          }
        }
      }
    }
  }
}

template <typename Tree>
const float* LeafData(const Tree& tree, const BlockIndex& block) {
  const auto* leaf = tree.probeConstLeaf(CoordOf(block));
  return leaf ? leaf->buffer().data() : nullptr;
}

}  // namespace

SurfaceMap::SurfaceMap(double voxel_size_m)
    : voxel_size_m_(voxel_size_m), grids_(std::make_unique<SurfaceGrids>()) {
  grids_->mean = openvdb::FloatGrid::create(0.f);
  grids_->weight = openvdb::FloatGrid::create(0.f);
  grids_->evidence = openvdb::Int32Grid::create(0);
  grids_->mean->setName("mean_m");
  grids_->weight->setName("weight");
  grids_->evidence->setName("free_evidence");
  for (openvdb::GridBase::Ptr g :
       {openvdb::GridBase::Ptr(grids_->mean), openvdb::GridBase::Ptr(grids_->weight),
        openvdb::GridBase::Ptr(grids_->evidence)}) {
    g->setTransform(CellCentred(voxel_size_m));
  }
}

SurfaceMap::SurfaceMap(SurfaceMap&&) noexcept = default;
SurfaceMap& SurfaceMap::operator=(SurfaceMap&&) noexcept = default;
SurfaceMap::~SurfaceMap() = default;

std::vector<BlockIndex> SurfaceMap::Apply(const SurfaceUpdate& update,
                                          const FusionOptions& options) {
  std::vector<BlockWork> work = GatherWork(update);
  // Topology first, by one thread; then every block on its own.
  openvdb::tree::ValueAccessor<openvdb::FloatTree> means(grids_->mean->tree()),
      weights(grids_->weight->tree());
  openvdb::tree::ValueAccessor<openvdb::Int32Tree> evidences(grids_->evidence->tree());
  constexpr FreeEvidence kSaturated{kSaturatedFrames, kSaturatedFrames, 0, 0};
  for (BlockWork& w : work) {
    const openvdb::Coord ijk = CoordOf(w.block);
    if (w.band) {
      w.mean = means.touchLeaf(ijk);
      w.weight = weights.touchLeaf(ijk);
    } else {
      w.mean = means.probeLeaf(ijk);
      w.weight = weights.probeLeaf(ijk);
    }
    w.evidence = evidences.probeLeaf(ijk);
    if (w.evidence) continue;
    const int32_t tile = evidences.getValue(ijk);
    const bool counts = w.free && ((w.free->probable != BlockMask{} && tile != kSaturated.Pack()) ||
                                   w.free->hit != BlockMask{});
    const bool contradicts = w.free && w.weight && w.free->contradicted != BlockMask{};
    if (counts || contradicts || (w.band && tile != 0)) w.evidence = evidences.touchLeaf(ijk);
  }
  tbb::parallel_for(size_t{0}, work.size(), [&](size_t i) {
    BlockFuser fuser(update, options, voxel_size_m_);
    fuser.Fuse(work[i]);
  });
  std::vector<BlockIndex> changed;
  for (const BlockWork& w : work) {
    if (w.changed) changed.push_back(w.block);
    if (w.evidence && w.uniform_evidence) {  // whole free blocks cost one tile
      const int32_t value = w.evidence->buffer().data()[0];
      if (value == kSaturated.Pack()) evidences.addTile(1, CoordOf(w.block), value, true);
    }
  }
  return changed;
}

std::vector<BlockIndex> SurfaceMap::Edit(RegionAction action, const Aabb& region,
                                         const std::function<double(const Eigen::Vector3d&)>& sdf,
                                         double truncation_m, const FusionOptions& options) {
  const double pad = action == RegionAction::kMarkOccupied ? truncation_m : 0;
  const Eigen::Vector3d padding = Eigen::Vector3d::Constant(pad);
  const VoxelIndex low = VoxelOf(region.min() - padding, voxel_size_m_);
  const VoxelIndex high = VoxelOf(region.max() + padding, voxel_size_m_);
  const BlockIndex first = BlockOf(low), last = BlockOf(high);
  openvdb::tree::ValueAccessor<openvdb::FloatTree> means(grids_->mean->tree()),
      weights(grids_->weight->tree());
  openvdb::tree::ValueAccessor<openvdb::Int32Tree> evidences(grids_->evidence->tree());
  constexpr FreeEvidence kSaturated{kSaturatedFrames, kSaturatedFrames, 0, 0};
  std::vector<BlockIndex> changed;
  for (int x = first.x; x <= last.x; ++x) {
    for (int y = first.y; y <= last.y; ++y) {
      for (int z = first.z; z <= last.z; ++z) {
        const BlockIndex block{x, y, z};
        bool touched = false;
        for (int o = 0; o < kBlockVoxels; ++o) {
          const VoxelIndex v = VoxelAt(block, o);
          const double d = sdf(VoxelCentre(v, voxel_size_m_));
          if (d > pad) continue;
          const openvdb::Coord ijk(v.x(), v.y(), v.z());
          touched = true;
          if (action == RegionAction::kMarkOccupied) {
            means.setValueOn(ijk, static_cast<float>(std::max(d, -truncation_m)));
            weights.setValueOn(ijk, options.max_weight);
            if (d <= 0) evidences.setValueOff(ijk, 0);
          } else {
            if (weights.isValueOn(ijk)) {
              means.setValueOff(ijk, 0.f);
              weights.setValueOff(ijk, 0.f);
            }
            if (action == RegionAction::kMarkFree) {
              evidences.setValueOn(ijk, kSaturated.Pack());
            } else {
              evidences.setValueOff(ijk, 0);
            }
          }
        }
        if (touched) changed.push_back(block);
      }
    }
  }
  return changed;
}

void SurfaceMap::ReadBand(const BlockIndex& block, float mean[kHaloVoxels],
                          float weight[kHaloVoxels]) const {
  ReadHalo(grids_->mean->constTree(), block, mean);
  ReadHalo(grids_->weight->constTree(), block, weight);
}

void SurfaceMap::ReadEvidence(const BlockIndex& block, int32_t evidence[kHaloVoxels]) const {
  ReadHalo(grids_->evidence->constTree(), block, evidence);
}

FreeEvidence SurfaceMap::EvidenceAt(const VoxelIndex& v) const {
  return FreeEvidence::Unpack(
      grids_->evidence->constTree().getValue(openvdb::Coord(v.x(), v.y(), v.z())));
}

const float* SurfaceMap::MeanBlock(const BlockIndex& block) const {
  return LeafData(grids_->mean->constTree(), block);
}

const float* SurfaceMap::WeightBlock(const BlockIndex& block) const {
  return LeafData(grids_->weight->constTree(), block);
}

std::vector<BlockIndex> SurfaceMap::BandBlocks() const {
  std::vector<BlockIndex> blocks;
  for (auto leaf = grids_->weight->tree().cbeginLeaf(); leaf; ++leaf) {
    if (leaf->isEmpty()) continue;
    const openvdb::Coord c = leaf->origin();
    blocks.push_back({c.x() >> 3, c.y() >> 3, c.z() >> 3});
  }
  std::sort(blocks.begin(), blocks.end());
  return blocks;
}

uint64_t SurfaceMap::MemoryBytes() const {
  return grids_->mean->memUsage() + grids_->weight->memUsage() + grids_->evidence->memUsage();
}

}  // namespace clearance
