#include "server/query/site_following.h"

#include <utility>

#include "absl/container/flat_hash_map.h"
#include "server/map/voxel.h"
#include "server/query/object_tree.h"

namespace clearance {
namespace {

constexpr float kMoveVoxels = 3.f / 32;
constexpr float kNormalCosine = 0.85f;
constexpr float kSigmaRatio = 1.6f;

// Of a voxel, by the type that hashes.
BlockIndex CellOf(const SurfaceSite& site, double voxel_size_m) {
  const VoxelIndex v = VoxelOf(site.p_L.cast<double>(), voxel_size_m);
  return {v.x(), v.y(), v.z()};
}

bool Stays(const SurfaceSite& old, const SurfaceSite& now, float voxel_size_m) {
  return (old.p_L - now.p_L).norm() <= kMoveVoxels * voxel_size_m &&
         old.normal_L.dot(now.normal_L) >= kNormalCosine &&
         old.sigma_m <= kSigmaRatio * now.sigma_m && now.sigma_m <= kSigmaRatio * old.sigma_m;
}

}  // namespace

std::shared_ptr<const ObjectShape> FollowSites(std::shared_ptr<const ObjectShape> published,
                                               std::vector<SurfaceSite> newest,
                                               double voxel_size_m) {
  if (published == nullptr) return BuildObjectShape(std::move(newest), voxel_size_m);
  absl::flat_hash_map<BlockIndex, const SurfaceSite*> known;
  known.reserve(published->sites.size());
  for (const SurfaceSite& site : published->sites) known[CellOf(site, voxel_size_m)] = &site;
  size_t stays = 0;
  for (SurfaceSite& site : newest) {
    const auto it = known.find(CellOf(site, voxel_size_m));
    if (it == known.end() || it->second == nullptr) continue;
    if (!Stays(*it->second, site, static_cast<float>(voxel_size_m))) continue;
    site = *std::exchange(it->second, nullptr);  // for one of the newest only
    ++stays;
  }
  if (stays == newest.size() && stays == published->sites.size()) return published;
  return BuildObjectShape(std::move(newest), voxel_size_m);
}

}  // namespace clearance
