#include "server/esdf/site_references.h"

#include <algorithm>

#include "server/esdf/sweep.h"
#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

// A site's voxel relative to the first voxel of the block that names it.
struct RelativeVoxel {
  int x, y, z;
  BlockIndex BlockFrom(const BlockIndex& origin) const {
    return {origin.x + (x >> 3), origin.y + (y >> 3), origin.z + (z >> 3)};
  }
  int Offset() const { return ((x & 7) << 6) | ((y & 7) << 3) | (z & 7); }
};

// Sites lie in [-128, 127] units about the centre of their own voxel.
RelativeVoxel SiteVoxel(int offset, const FieldVoxel& v) {
  return {(offset >> 6) + ((v.dx + 128) >> 8), ((offset >> 3) & 7) + ((v.dy + 128) >> 8),
          (offset & 7) + ((v.dz + 128) >> 8)};
}

// Calls fn(offset, voxel, site voxel, site block) for each voxel whose site is in gone() of one of
// `changed`, until fn returns false.
template <typename Block, typename Fn>
void ForEachNamingGone(const BlockIndex& index, Block& block, const ChangedSites& changed,
                       const Fn& fn) {
  BlockIndex last_block = index;
  const SiteBlock* last = nullptr;
  bool has_last = false;
  for (int o = 0; o < kBlockVoxels; ++o) {
    auto& v = block.voxels[o];
    if (!v.has_site()) continue;
    const RelativeVoxel u = SiteVoxel(o, v);
    const BlockIndex site_block = u.BlockFrom(index);
    if (!has_last || site_block != last_block) {
      has_last = true;
      last_block = site_block;
      last = nullptr;
      for (const SiteBlock* s : changed) {
        if (s->index() == site_block) last = s;
      }
    }
    if (last && Test(last->gone(), u.Offset()) && !fn(o, v, u, *last)) return;
  }
}

}  // namespace

ReferencedBlockList ReferencedBlocks(const BlockIndex& index, const FieldBlock& block) {
  ReferencedBlockList found;
  BlockIndex last;
  for (int o = 0; o < kBlockVoxels; ++o) {
    const FieldVoxel& v = block.voxels[o];
    if (!v.has_site()) continue;
    const BlockIndex site_block = SiteVoxel(o, v).BlockFrom(index);
    if (!found.empty() && site_block == last) continue;
    last = site_block;
    if (std::find(found.begin(), found.end(), site_block) == found.end()) {
      found.push_back(site_block);
    }
  }
  return found;
}

bool NamesGoneSite(const BlockIndex& index, const FieldBlock& block, const ChangedSites& changed) {
  bool any = false;
  ForEachNamingGone(index, block, changed,
                    [&](int, const FieldVoxel&, const RelativeVoxel&, const SiteBlock&) {
                      any = true;
                      return false;
                    });
  return any;
}

void FollowSites(const BlockIndex& index, const ChangedSites& changed, int32_t squared_limit,
                 FieldBlock* block) {
  ForEachNamingGone(index, *block, changed,
                    [&](int o, FieldVoxel& v, const RelativeVoxel& u, const SiteBlock& sites) {
                      const uint16_t own = v.attributes & kVoxelBits;
                      FieldVoxel followed;
                      if (const FieldVoxel* site = sites.Find(u.Offset())) {
                        followed.dx = static_cast<int16_t>(256 * (u.x - (o >> 6)) + site->dx);
                        followed.dy = static_cast<int16_t>(256 * (u.y - ((o >> 3) & 7)) + site->dy);
                        followed.dz = static_cast<int16_t>(256 * (u.z - (o & 7)) + site->dz);
                        followed.attributes = site->attributes;
                        if (SquaredUnits(followed) > squared_limit) followed = {};
                      }
                      v = followed;
                      v.attributes = (followed.attributes & kSiteBits) | own;
                      return true;
                    });
}

}  // namespace clearance
