#include "server/integration/surface_fields.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/integration/dilation.h"
#include "server/integration/smallest_axis.h"
#include "server/map/surface_map.h"

namespace clearance {
namespace {

constexpr size_t kChunkVoxels = 512;
// A centroid of few points is worse than its neighbours of many: its noise term grows with the
// square of the ratio, up to this factor.
constexpr float kMaxNoiseFactor = 100.f;
// Shifts beyond this share of a voxel are edges or noise, not curvature.
constexpr float kMaxShiftVoxels = 0.5f;

constexpr double kMaxStrayShare = 0.2;
constexpr uint32_t kDensePoints = 10;

// Noise of half a voxel scatters points over the voxels before and behind the surface. Those hold
// few; a share of the neighbours' points tells them from thin surface, but only where there is
// noise.
float StrayShare(double noise_voxels) {
  return static_cast<float>(std::clamp((noise_voxels - 0.1) / 0.3, 0.0, 1.0) * kMaxStrayShare);
}

// The miss of a centroid is noise as well as curvature.
float ShiftGain(double noise_voxels) {
  const double ratio = noise_voxels / 0.2;
  return static_cast<float>(1.0 / (1.0 + ratio * ratio));
}

}  // namespace

SurfaceFields::SurfaceFields(const LocalVoxels& voxels, const BlockTable& table,
                             const Eigen::Vector3d& sensor_M, double noise_m,
                             const GpOptions& options)
    : voxels_(voxels),
      table_(table),
      sensor_M_(sensor_M),
      options_(options),
      length_m_(static_cast<float>(options.length_scale_voxels * voxels.voxel_size_m)),
      stray_share_(StrayShare(noise_m / voxels.voxel_size_m)),
      shift_gain_(ShiftGain(noise_m / voxels.voxel_size_m)),
      location_(voxels.offset.size()),
      block_of_(voxels.offset.size()),
      stray_(voxels.offset.size()),
      needed_(voxels.offset.size()),
      normal_(voxels.offset.size(), Eigen::Vector3f::Zero()),
      shift_(voxels.offset.size(), Eigen::Vector3f::Zero()) {
  if (options_.kernel != KernelType::kSquaredExponential) reference_.resize(voxels.offset.size());
  for (size_t b = 0; b < voxels.blocks.size();) {
    Chunk chunk;
    chunk.first_block = b;
    const uint32_t begin = voxels.blocks[b].begin;
    while (b < voxels.blocks.size() && voxels.blocks[b].begin - begin < kChunkVoxels) ++b;
    chunk.last_block = b;
    chunks_.push_back(std::move(chunk));
  }
  tbb::parallel_for(size_t{0}, chunks_.size(), [&](size_t c) {
    for (size_t b = chunks_[c].first_block; b < chunks_[c].last_block; ++b) {
      std::fill(block_of_.begin() + voxels_.blocks[b].begin,
                block_of_.begin() + voxels_.blocks[b].end, static_cast<uint32_t>(b));
      if (stray_share_ > 0) FindStrays(b);
    }
  });
}

void SurfaceFields::Train(const std::vector<uint8_t>& wanted) {
  Need(wanted);
  tbb::parallel_for(size_t{0}, chunks_.size(),
                    [&](size_t c) { TrainChunk(static_cast<uint32_t>(c)); });
}

SurfaceFields::Halo SurfaceFields::HaloOf(size_t block) const {
  Halo at;
  at.fill(-1);
  const std::array<BlockMask, 27>& rims = RimMasks(1);
  const std::array<int32_t, 27> around = table_.Around(voxels_.blocks[block].block);
  for (int k = 0; k < 27; ++k) {
    if (around[k] < 0) continue;
    const Eigen::Vector3i step = StepAround(k) * kBlockSide;
    for (uint32_t i = voxels_.blocks[around[k]].begin; i < voxels_.blocks[around[k]].end; ++i) {
      if (!Test(rims[k], voxels_.offset[i])) continue;
      const VoxelIndex v = VoxelAt({0, 0, 0}, voxels_.offset[i]) + step;
      at[HaloOffset(v.x(), v.y(), v.z())] = static_cast<int32_t>(i);
    }
  }
  return at;
}

namespace {

// Calls fn(halo offset, voxel index) for the 3x3x3 voxels around a voxel of a block.
template <typename Fn>
void ForEachAround(const VoxelIndex& v, const Fn& fn) {
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const VoxelIndex w = v + VoxelIndex(dx, dy, dz);
        fn(HaloOffset(w.x(), w.y(), w.z()), w);
      }
    }
  }
}

}  // namespace

void SurfaceFields::FindStrays(size_t block) {
  const Halo at = HaloOf(block);
  for (uint32_t i = voxels_.blocks[block].begin; i < voxels_.blocks[block].end; ++i) {
    uint32_t most = 0;
    ForEachAround(VoxelAt({0, 0, 0}, voxels_.offset[i]), [&](int h, const VoxelIndex&) {
      if (at[h] >= 0) most = std::max(most, voxels_.count[at[h]]);
    });
    stray_[i] = most >= kDensePoints &&
                static_cast<float>(voxels_.count[i]) < stray_share_ * static_cast<float>(most);
  }
}

// The shifts of a field's points come from the fields of their own voxels.
void SurfaceFields::Need(const std::vector<uint8_t>& wanted) {
  std::vector<BlockMask> masks(voxels_.blocks.size());
  std::vector<uint8_t> any(voxels_.blocks.size());
  tbb::parallel_for(size_t{0}, masks.size(), [&](size_t b) {
    for (uint32_t i = voxels_.blocks[b].begin; i < voxels_.blocks[b].end; ++i) {
      if (wanted[i]) Set(masks[b], voxels_.offset[i]);
    }
    any[b] = masks[b] != BlockMask{};
  });
  tbb::parallel_for(size_t{0}, masks.size(), [&](size_t b) {
    std::array<const BlockMask*, 27> around{};
    bool none = true;
    const std::array<int32_t, 27> ids = table_.Around(voxels_.blocks[b].block);
    for (int k = 0; k < 27; ++k) {
      if (ids[k] < 0 || !any[ids[k]]) continue;
      around[k] = &masks[ids[k]];
      none = false;
    }
    if (none) return;
    const BlockMask needed = Dilated(around);
    for (uint32_t i = voxels_.blocks[b].begin; i < voxels_.blocks[b].end; ++i) {
      needed_[i] = Test(needed, voxels_.offset[i]);
    }
  });
}

void SurfaceFields::Gather(size_t block, std::vector<Neighbourhood>& out) const {
  const uint32_t begin = voxels_.blocks[block].begin, end = voxels_.blocks[block].end;
  if (std::none_of(needed_.begin() + begin, needed_.begin() + end,
                   [](uint8_t needed) { return needed != 0; })) {
    return;
  }
  const float block_m = static_cast<float>(kBlockSide * voxels_.voxel_size_m);
  const Halo at = HaloOf(block);
  for (uint32_t i = begin; i < end; ++i) {
    if (!needed_[i]) continue;
    Neighbourhood& n = out.emplace_back();
    n.own = i;
    float points = 0;
    uint32_t most = 0;
    ForEachAround(VoxelAt({0, 0, 0}, voxels_.offset[i]), [&](int h, const VoxelIndex& w) {
      const int32_t j = at[h];
      if (j < 0) return;
      // From the origin of the voxel's own block.
      const Eigen::Vector3f step(static_cast<float>(w.x() >> 3), static_cast<float>(w.y() >> 3),
                                 static_cast<float>(w.z() >> 3));
      n.voxel[n.count] = static_cast<uint32_t>(j);
      n.point[n.count] = voxels_.centroid[j] + step * block_m;
      points += static_cast<float>(voxels_.count[j]);
      most = std::max(most, voxels_.count[j]);
      ++n.count;
    });
    if (stray_share_ > 0 && most >= kDensePoints) {
      const float fewest = stray_share_ * static_cast<float>(most);
      int kept = 0;
      points = 0;
      for (int k = 0; k < n.count; ++k) {
        if (static_cast<float>(voxels_.count[n.voxel[k]]) < fewest) continue;
        n.voxel[kept] = n.voxel[k];
        n.point[kept] = n.point[k];
        points += static_cast<float>(voxels_.count[n.voxel[k]]);
        ++kept;
      }
      n.count = kept;
    }
    const float mean_points = points / static_cast<float>(n.count);
    for (int k = 0; k < n.count; ++k) {
      const float ratio =
          std::max(1.f, mean_points / static_cast<float>(voxels_.count[n.voxel[k]]));
      n.noise_variance[k] =
          static_cast<float>(options_.noise_variance) * std::min(ratio * ratio, kMaxNoiseFactor);
    }
  }
}

void SurfaceFields::TrainChunk(uint32_t chunk_id) {
  Chunk& chunk = chunks_[chunk_id];
  std::vector<Neighbourhood> neighbourhoods;
  const auto first = needed_.begin() + voxels_.blocks[chunk.first_block].begin;
  const auto last = needed_.begin() + voxels_.blocks[chunk.last_block - 1].end;
  neighbourhoods.reserve(static_cast<size_t>(std::count(first, last, 1)));
  for (size_t b = chunk.first_block; b < chunk.last_block; ++b) Gather(b, neighbourhoods);
  // Lanes of a batch should be of one size: voxels in the order of their point counts.
  std::vector<uint32_t> order(neighbourhoods.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<uint32_t>(i);
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return neighbourhoods[a].count < neighbourhoods[b].count;
  });
  size_t storage = 0;
  for (size_t i = 0; i < order.size(); i += kLanes) {
    Batch batch;
    const size_t lanes = std::min<size_t>(kLanes, order.size() - i);
    batch.size = neighbourhoods[order[i + lanes - 1]].count;
    batch.storage = storage;
    storage += GpBatch::Size(batch.size);
    for (size_t lane = 0; lane < kLanes; ++lane) {
      const Neighbourhood& n = neighbourhoods[order[i + (lane < lanes ? lane : 0)]];
      batch.voxel[lane] = n.own;
      if (lane < lanes) {
        location_[n.own] = {chunk_id, static_cast<uint32_t>(chunk.batches.size()),
                            static_cast<uint32_t>(chunk.neighbours.size()),
                            static_cast<uint8_t>(lane), static_cast<uint8_t>(n.count)};
        chunk.neighbours.insert(chunk.neighbours.end(), n.voxel.begin(), n.voxel.begin() + n.count);
      }
    }
    chunk.batches.push_back(batch);
  }
  chunk.storage.resize(storage);
  for (size_t b = 0; b < chunk.batches.size(); ++b) {
    const Batch& batch = chunk.batches[b];
    GpBatch gp(chunk.storage.data() + batch.storage, batch.size);
    const Neighbourhood* of_lane[kLanes];
    for (size_t lane = 0; lane < kLanes; ++lane) {
      const size_t at = b * kLanes + lane;
      const Neighbourhood& n = neighbourhoods[order[at < order.size() ? at : b * kLanes]];
      of_lane[lane] = &n;
      const int slot = static_cast<int>(lane);
      for (int i = 0; i < n.count; ++i) gp.SetPoint(i, slot, n.point[i], n.noise_variance[i]);
      for (int i = n.count; i < batch.size; ++i) gp.Pad(i, slot);
    }
    gp.Train(length_m_);
    FindNormalsAndShifts(chunk, batch, of_lane);
  }
}

void SurfaceFields::FindNormalsAndShifts(const Chunk& chunk, const Batch& batch,
                                         const Neighbourhood* const neighbourhoods[kLanes]) {
  const float limit_m = kMaxShiftVoxels * static_cast<float>(voxels_.voxel_size_m);
  std::array<Lanes, 3> own;
  for (int lane = 0; lane < kLanes; ++lane) {
    const Eigen::Vector3f& p = voxels_.centroid[batch.voxel[lane]];
    for (int k = 0; k < 3; ++k) own[k][lane] = p[k];
  }
  std::array<Lanes, 3> foot;
  const GpBatch gp(const_cast<Lanes*>(chunk.storage.data()) + batch.storage, batch.size);
  gp.Foot(own.data(), length_m_, foot.data());
  for (int lane = 0; lane < kLanes; ++lane) {
    const uint32_t voxel = batch.voxel[lane];
    const Neighbourhood& n = *neighbourhoods[lane];
    const BlockIndex& block = voxels_.blocks[block_of_[voxel]].block;
    const Eigen::Vector3f p = voxels_.centroid[voxel];
    const Eigen::Vector3f view =
        (sensor_M_ - BlockOrigin(block, voxels_.voxel_size_m)).cast<float>() - p;
    Eigen::Vector3f normal =
        SmallestAxis(n.point.data(), n.noise_variance.data(), n.count, view.normalized());
    if (normal.dot(view) < 0) normal = -normal;
    normal_[voxel] = normal;
    // On curved surface the weighted mean lies towards the centre of curvature; the centroid itself
    // shows by how much. Moving every centroid by its own miss undoes most of it.
    const Eigen::Vector3f f(foot[0][lane], foot[1][lane], foot[2][lane]);
    const float miss = normal.dot(p - f);
    shift_[voxel] = std::abs(miss) < limit_m ? Eigen::Vector3f(shift_gain_ * miss * normal)
                                             : Eigen::Vector3f(Eigen::Vector3f::Zero());
    if (!reference_.empty()) {
      const Kernel kernel(options_.kernel, length_m_);
      reference_[voxel] = LocalGpField::Train(
          Eigen::Map<const Eigen::Matrix3Xf>(n.point[0].data(), 3, n.count),
          Eigen::Map<const Eigen::ArrayXf>(n.noise_variance.data(), n.count), kernel);
      shift_[voxel].setZero();
    }
  }
}

SurfaceFields::Samples SurfaceFields::Evaluate(uint32_t voxel,
                                               const std::array<Lanes, 3>& x) const {
  if (!reference_.empty()) return EvaluateReference(voxel, x);
  const Location& at = location_[voxel];
  const Chunk& chunk = chunks_[at.chunk];
  const Batch& batch = chunk.batches[at.batch];
  std::array<Eigen::Vector3f, GpBatch::kMaxPoints> shift;
  const uint32_t* neighbours = &chunk.neighbours[at.neighbours];
  for (int i = 0; i < at.count; ++i) shift[i] = shift_[neighbours[i]];
  const GpBatch gp(const_cast<Lanes*>(chunk.storage.data()) + batch.storage, batch.size);
  const GpBatch::Samples s = gp.Evaluate(at.lane, at.count, shift.data(), length_m_, x);
  return {s.latent, s.variance, {s.foot[0] - x[0], s.foot[1] - x[1], s.foot[2] - x[2]}};
}

SurfaceFields::Samples SurfaceFields::EvaluateReference(uint32_t voxel,
                                                        const std::array<Lanes, 3>& x) const {
  Samples out{Splat(0), Splat(1), {Splat(0), Splat(0), Splat(0)}};
  if (!reference_[voxel]) return out;
  Eigen::Matrix3Xf points(3, kLanes);
  for (int k = 0; k < kLanes; ++k) points.col(k) << x[0][k], x[1][k], x[2][k];
  const LocalGpField::Samples s = reference_[voxel]->EvaluateMany(points);
  for (int k = 0; k < kLanes; ++k) {
    out.latent[k] = s.latent[k];
    out.variance[k] = s.variance[k];
    for (int axis = 0; axis < 3; ++axis) out.to_foot[axis][k] = s.foot(axis, k) - x[axis][k];
  }
  return out;
}

}  // namespace clearance
