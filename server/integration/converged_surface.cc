#include "server/integration/converged_surface.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/integration/stored_surface.h"

namespace clearance {
namespace {

constexpr float kLooks = 2.f;         // without noise
constexpr double kSlightNoise = 0.1;  // in voxels; twice the looks
constexpr float kOnSurface = 0.1f;    // in voxels, of the centroid from the stored surface
constexpr float kGuessDepth = 0.5f;   // deeper, looks from the front are limited (GuessedWeight)
constexpr float kMostGuessed = 2.f;
constexpr float kFlat = 0.15f;        // in voxels, the voxels beside from the plane
constexpr float kLeastWeight = 0.3f;  // of the voxels beside, ...
constexpr float kSureBand = 1.f;      // ... so many voxels from the surface at most

// The weight that a mean has after so many looks: 1 - v falls like exp(-d^2 / l^2), and with the
// depth behind the surface (DecideBandValue).
float WeightAfter(float looks, float mean_voxels) {
  const float weight =
      looks * std::exp(-mean_voxels * mean_voxels) * std::min(1.f, 1.f + 0.5f * mean_voxels);
  return mean_voxels <= -kGuessDepth ? std::min(weight, kMostGuessed) : weight;
}

constexpr float kInCube = 0.9f;     // in voxels: half a cube's diagonal
constexpr float kSamePlane = 0.3f;  // in voxels, between what is stored and the plane

class Knower {
 public:
  Knower(const LocalVoxels& voxels, const LocalVoxels::Block& block, const SurfaceMap& existing)
      : voxels_(voxels),
        block_(block),
        h_(static_cast<float>(voxels.voxel_size_m)),
        stored_(existing, block.block) {}

  KnownSurface Find(float looks) {
    if (stored_.empty()) return {};
    for (uint32_t i = block_.begin; i < block_.end; ++i) {
      const int o = voxels_.offset[i];
      const float mean = stored_.mean(o), weight = stored_.weight(o);
      if (!(weight > 0) || std::abs(mean) > h_ || !(weight >= WeightAfter(looks, mean / h_))) {
        continue;
      }
      const StoredSurface::Around around = stored_.AroundOf(o);
      const Eigen::Vector3f normal = stored_.Normal(o, around);
      if (normal.isZero()) continue;
      const Eigen::Vector3f centre =
          (VoxelAt({0, 0, 0}, o).cast<float>() + Eigen::Vector3f::Constant(0.5f)) * h_;
      const float off = mean + normal.dot(voxels_.centroid[i] - centre);
      if (!(std::abs(off) < kOnSurface * h_) || !IsFlat(around, normal, mean)) continue;
      Set(known_.converged, o);
      Set(known_.confirmed[KnownSurface::kOwn], o);
      ConfirmBeside(around, normal, mean);
    }
    return known_;
  }

 private:
  // Whether the voxels beside hold the same plane, as far as the band is sure to reach. At edges
  // they do not: there the next look may know better.
  bool IsFlat(const StoredSurface::Around& around, const Eigen::Vector3f& normal,
              float mean) const {
    for (int n = 0; n < 6; ++n) {
      const float expected = mean + (n & 1 ? normal[n >> 1] : -normal[n >> 1]) * h_;
      if (std::abs(expected) < kSureBand * h_ &&
          (around[n].weight < kLeastWeight || std::abs(around[n].mean - expected) > kFlat * h_)) {
        return false;
      }
    }
    return true;
  }

  void ConfirmBeside(const StoredSurface::Around& around, const Eigen::Vector3f& normal,
                     float mean) {
    for (int n = 0; n < 6; ++n) {
      const StoredSurface::Voxel& v = around[n];
      const float expected = mean + (n & 1 ? normal[n >> 1] : -normal[n >> 1]) * h_;
      if (v.weight > 0 && std::abs(v.mean) <= kInCube * h_ &&
          std::abs(v.mean - expected) <= kSamePlane * h_) {
        Set(known_.confirmed[v.block], v.offset);
      }
    }
  }

  const LocalVoxels& voxels_;
  const LocalVoxels::Block& block_;
  const float h_;
  StoredSurface stored_;
  KnownSurface known_;
};

}  // namespace

std::vector<KnownSurface> FindKnownSurface(const LocalVoxels& voxels, const SurfaceMap& existing,
                                           double noise_m) {
  const double noise = noise_m / voxels.voxel_size_m / kSlightNoise;
  const float looks = kLooks * static_cast<float>(1.0 + noise * noise);
  std::vector<KnownSurface> known(voxels.blocks.size());
  tbb::parallel_for(size_t{0}, voxels.blocks.size(), [&](size_t b) {
    known[b] = Knower(voxels, voxels.blocks[b], existing).Find(looks);
  });
  return known;
}

}  // namespace clearance
