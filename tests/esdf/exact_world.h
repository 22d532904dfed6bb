// A surface map filled with exact distances of an analytic scene that may change between frames.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <set>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "server/esdf/exact_transform.h"
#include "server/esdf/field_updater.h"
#include "server/map/surface_map.h"
#include "tests/testing/analytic_scene.h"

namespace clearance::testing {

class ExactWorld {
 public:
  explicit ExactWorld(double voxel_size_m) : h_(voxel_size_m), map_(voxel_size_m) {}

  const SurfaceMap& map() const { return map_; }
  std::vector<Solid>& solids() { return solids_; }
  const std::vector<Solid>& solids() const { return solids_; }

  // Makes the map show the scene exactly in `box` (whole blocks), with weight `weight`; voxels
  // farther than two from any surface are unknown, and free where `free` says so. Returns the
  // changed blocks.
  std::vector<BlockIndex> Show(const std::vector<Aabb>& boxes, bool free = false,
                               float weight = 3.f) {
    std::set<BlockIndex> blocks;
    for (const Aabb& box : boxes) {
      const BlockIndex low = BlockOf(VoxelOf(box.min(), h_));
      const BlockIndex high = BlockOf(VoxelOf(box.max(), h_));
      for (int x = low.x; x <= high.x; ++x) {
        for (int y = low.y; y <= high.y; ++y) {
          for (int z = low.z; z <= high.z; ++z) blocks.insert({x, y, z});
        }
      }
    }
    const AnalyticScene scene("", solids_);
    SurfaceUpdate update;
    for (const BlockIndex& b : blocks) {
      update.released.push_back({b, kFullMask});
      BandObservations::Block band{b, static_cast<uint32_t>(update.band.offset.size()), 0};
      FreeBlock seen_free{b};
      for (int o = 0; o < kBlockVoxels; ++o) {
        const double d = solids_.empty() ? 1e9 : scene.Distance(VoxelCentre(VoxelAt(b, o), h_));
        if (free && d > h_) Set(seen_free.probable, o);
        if (free && d > h_) Set(seen_free.confident, o);
        if (std::abs(d) > 2 * h_) continue;
        update.band.offset.push_back(static_cast<uint16_t>(o));
        update.band.distance_m.push_back(static_cast<float>(d));
        update.band.weight.push_back(weight);
      }
      band.end = static_cast<uint32_t>(update.band.offset.size());
      if (band.end > band.begin) update.band.blocks.push_back(band);
      if (free) update.free.push_back(seen_free);
    }
    return map_.Apply(update, fusion_);
  }

  // Bounds of a solid with the band around it.
  Aabb Bounds(const Solid& solid) const {
    Eigen::Vector3d half = solid.size / 2;
    if (solid.kind == Solid::Kind::kSphere) half.setConstant(solid.size.x());
    if (solid.kind == Solid::Kind::kCylinder)
      half = {solid.size.x(), solid.size.x(), solid.size.z() / 2};
    const double reach = half.norm() + 3 * h_;
    const Eigen::Vector3d c = solid.T_W_P.translation();
    return {c - Eigen::Vector3d::Constant(reach), c + Eigen::Vector3d::Constant(reach)};
  }

 private:
  double h_;
  SurfaceMap map_;
  FusionOptions fusion_;
  std::vector<Solid> solids_;
};

// A small solid at a random place within +-extent of `centre`.
template <typename Rng>
Solid RandomSolid(Rng& rng, const Eigen::Vector3d& centre, double extent_m) {
  std::uniform_real_distribution<double> u(-1, 1);
  Solid s;
  s.T_W_P = RandomPose(static_cast<uint32_t>(rng()), 0.0);
  s.T_W_P.translation() = centre + extent_m * Eigen::Vector3d(u(rng), u(rng), u(rng));
  switch (rng() % 3) {
    case 0:
      s.kind = Solid::Kind::kSphere;
      s.size = Eigen::Vector3d(0.5 + 0.3 * u(rng), 0, 0);
      break;
    case 1:
      s.kind = Solid::Kind::kBox;
      s.size = Eigen::Vector3d(0.8 + 0.5 * u(rng), 0.8 + 0.5 * u(rng), 0.8 + 0.5 * u(rng));
      break;
    default:
      s.kind = Solid::Kind::kCylinder;
      s.size = Eigen::Vector3d(0.15 + 0.1 * u(rng), 0, 1.5 + u(rng));
  }
  return s;
}

// Positions of all sites of a field, in metres.
inline std::vector<Eigen::Vector3d> SitePositions(const SiteTable& sites, double voxel_size_m) {
  std::vector<Eigen::Vector3d> positions;
  for (const SiteBlock& block : sites) {
    ForEachSet(block.mask(), [&](int o) {
      const Eigen::Vector3d offset =
          block.Find(o)->to_site_voxels().template cast<double>() * voxel_size_m;
      positions.push_back(VoxelCentre(VoxelAt(block.index(), o), voxel_size_m) + offset);
    });
  }
  return positions;
}

// How far a field is from the exact transform of the sites it is built from, in voxels.
struct FieldErrors {
  size_t voxels = 0;
  size_t phantoms = 0;  // voxels that name a site that does not exist there
  size_t missing = 0;   // voxels without a site though one is in reach by more than a voxel
  double mean = 0, p99 = 0, max = 0;
};

// Looks at every voxel for phantoms and at every `stride`-th for its distance.
inline FieldErrors CompareWithExact(const DistanceField& field, const SiteTable& sites,
                                    int stride = 1) {
  const double h = field.voxel_size_m();
  const ExactTransform exact(SitePositions(sites, h), h, field.max_distance_m());
  absl::flat_hash_map<BlockIndex, const SiteBlock*> site_blocks;
  for (const SiteBlock& s : sites) site_blocks[s.index()] = &s;
  FieldErrors result;
  std::vector<double> errors;
  int counter = 0;
  field.ForEach([&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t) {
    for (int o = 0; o < kBlockVoxels; ++o) {
      const VoxelIndex voxel = VoxelAt(b, o);
      const FieldVoxel v = data ? data->voxels[o] : FieldVoxel{};
      if (v.has_site()) {
        const VoxelIndex u =
            voxel + VoxelIndex((v.dx + 128) >> 8, (v.dy + 128) >> 8, (v.dz + 128) >> 8);
        const auto it = site_blocks.find(BlockOf(u));
        const FieldVoxel* site = it == site_blocks.end() ? nullptr : it->second->Find(OffsetOf(u));
        const VoxelIndex step = u - voxel;
        if (!site || site->dx + 256 * step.x() != v.dx || site->dy + 256 * step.y() != v.dy ||
            site->dz + 256 * step.z() != v.dz) {
          ++result.phantoms;
        }
      }
      if (counter++ % stride) continue;
      const ExactTransform::Nearest nearest = exact.Find(VoxelCentre(voxel, h));
      if (!v.has_site()) {
        if (nearest.site >= 0 && nearest.distance_m < field.max_distance_m() - h) {
          ++result.missing;
        }
        continue;
      }
      if (nearest.site < 0) continue;  // at the limit, by rounding
      errors.push_back(v.to_site_voxels().cast<double>().norm() - nearest.distance_m / h);
    }
  });
  result.voxels = errors.size();
  if (errors.empty()) return result;
  std::sort(errors.begin(), errors.end());
  for (double e : errors) result.mean += e;
  result.mean /= static_cast<double>(errors.size());
  result.p99 = errors[errors.size() * 99 / 100];
  result.max = std::max(errors.back(), -errors.front());
  return result;
}

}  // namespace clearance::testing
