#include "server/esdf/seeding.h"

#include <algorithm>

#include "server/esdf/sweep.h"
#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

std::array<BlockMask, 27> MakeBorderMasks() {
  std::array<BlockMask, 27> masks{};
  for (int d = 0; d < 27; ++d) {
    const int step[3] = {d / 9 - 1, d / 3 % 3 - 1, d % 3 - 1};
    for (int o = 0; o < kBlockVoxels; ++o) {
      const int at[3] = {o >> 6, (o >> 3) & 7, o & 7};
      bool touches = true;
      for (int a = 0; a < 3; ++a) {
        if (step[a] < 0 && at[a] != 0) touches = false;
        if (step[a] > 0 && at[a] != 7) touches = false;
      }
      if (touches) Set(masks[d], o);
    }
  }
  return masks;
}

// Offers one site, whose own voxel is (x, y, z) in the block's coordinates (-1..8 each).
void OfferAround(int x, int y, int z, const FieldVoxel& site, int32_t squared_limit,
                 FieldBlock* block) {
  for (int vx = std::max(x - 1, 0); vx <= std::min(x + 1, 7); ++vx) {
    for (int vy = std::max(y - 1, 0); vy <= std::min(y + 1, 7); ++vy) {
      for (int vz = std::max(z - 1, 0); vz <= std::min(z + 1, 7); ++vz) {
        FieldVoxel& v = block->voxels[(vx << 6) | (vy << 3) | vz];
        FieldVoxel offer = site;
        offer.dx = static_cast<int16_t>(site.dx + 256 * (x - vx));
        offer.dy = static_cast<int16_t>(site.dy + 256 * (y - vy));
        offer.dz = static_cast<int16_t>(site.dz + 256 * (z - vz));
        const int32_t length = SquaredUnits(offer);
        if (length > squared_limit || (v.has_site() && length >= SquaredUnits(v))) continue;
        offer.attributes = (site.attributes & kSiteBits) | (v.attributes & kVoxelBits);
        v = offer;
      }
    }
  }
}

}  // namespace

const BlockMask& BorderMask(int d) {
  static const std::array<BlockMask, 27> masks = MakeBorderMasks();
  return masks[d];
}

void SeedBlock(const SiteNeighbourhood& sites, bool only_fresh, int32_t squared_limit,
               FieldBlock* block) {
  for (int d = 0; d < 27; ++d) {
    if (!sites[d]) continue;
    const int shift[3] = {8 * (d / 9 - 1), 8 * (d / 3 % 3 - 1), 8 * (d % 3 - 1)};
    BlockMask offered = only_fresh ? sites[d]->fresh() : sites[d]->mask();
    // The neighbour's voxels that touch this block: seen from there, we are in direction 26 - d.
    for (int w = 0; w < 8; ++w) offered[w] &= BorderMask(26 - d)[w];
    ForEachSet(offered, [&](int o) {
      OfferAround((o >> 6) + shift[0], ((o >> 3) & 7) + shift[1], (o & 7) + shift[2],
                  *sites[d]->Find(o), squared_limit, block);
    });
  }
}

}  // namespace clearance
