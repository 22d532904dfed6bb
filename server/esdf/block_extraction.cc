#include "server/esdf/block_extraction.h"

#include <cstring>

#include "server/esdf/seeding.h"
#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

BlockShadow ShadowOf(const float* mean, const float* weight, const int32_t* evidence) {
  BlockShadow shadow;
  for (int x = 0; x < 8; ++x) {
    uint64_t observed = 0, band = 0;
    for (int y = 0; y < 8; ++y) {
      const int h = HaloOffset(x, y, 0);
      uint64_t row_band = 0, row_free = 0;
      for (int z = 0; z < 8; ++z) {
        row_band |= uint64_t{weight[h + z] > 0.f} << z;
        row_free |= uint64_t{evidence[h + z] != 0} << z;
      }
      band |= row_band << (8 * y);
      observed |= (row_band | row_free) << (8 * y);
    }
    shadow.observed[x] = observed;
    shadow.band[x] = band;
    if (band == 0) continue;
    for (int y = 0; y < 8; ++y) {
      for (const float* values : {mean, weight}) {
        uint64_t words[4];
        std::memcpy(words, values + HaloOffset(x, y, 0), sizeof(words));
        for (uint64_t w : words) {
          shadow.band_hash = (shadow.band_hash ^ w) * 0x9e3779b97f4a7c15ull;
          shadow.band_hash ^= shadow.band_hash >> 29;
        }
      }
    }
  }
  return shadow;
}

}  // namespace

void ExtractBlock(const SurfaceMap& map, const BlockIndex& block, float min_weight,
                  BlockExtraction* out) {
  float mean[kHaloVoxels], weight[kHaloVoxels];
  int32_t evidence[kHaloVoxels];
  map.ReadBand(block, mean, weight);
  map.ReadEvidence(block, evidence);
  out->shadow = ShadowOf(mean, weight, evidence);
  if (out->shadow.band == BlockMask{}) {
    out->sites.mask = {};
    ClassifyByEvidence(weight, evidence, out->states.data());
    return;
  }
  const float h = static_cast<float>(map.voxel_size_m());
  ExtractSites(mean, weight, h, min_weight, &out->sites);
  ClassifyVoxels(mean, weight, evidence, out->sites, h, min_weight, out->states.data());
}

uint32_t ConcernedNeighbours(const BlockShadow& before, const BlockShadow& after) {
  if (before == after) return 0;
  const bool band_changed = before.band != after.band || before.band_hash != after.band_hash;
  BlockMask changed;
  for (int w = 0; w < 8; ++w) {
    changed[w] = before.observed[w] ^ after.observed[w];
    if (band_changed) changed[w] |= before.band[w] | after.band[w];
  }
  uint32_t directions = 0;
  for (int d = 0; d < 27; ++d) {
    if (d != 13 && Intersects(changed, BorderMask(d))) directions |= 1u << d;
  }
  return directions;
}

}  // namespace clearance
