#include "server/esdf/block_extraction.h"

#include <cstring>

#include "server/esdf/seeding.h"
#include "server/esdf/voxel_state.h"
#include "server/map/observed_voxels.h"

namespace clearance {
namespace {

// Of the means and weights of a block's layers that hold band.
uint64_t BandHash(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                  const BlockMask& band) {
  uint64_t hash = 0;
  for (int x = 0; x < 8; ++x) {
    if (band[x] == 0) continue;
    for (int y = 0; y < 8; ++y) {
      for (const float* values : {mean, weight}) {
        uint64_t words[4];
        std::memcpy(words, values + HaloOffset(x, y, 0), sizeof(words));
        for (uint64_t w : words) {
          hash = (hash ^ w) * 0x9e3779b97f4a7c15ull;
          hash ^= hash >> 29;
        }
      }
    }
  }
  return hash;
}

}  // namespace

void ExtractBlock(const SurfaceMap& map, const BlockIndex& block, float min_weight,
                  BlockExtraction* out) {
  ObservedVoxels observed;
  ReadObserved(map, block, &observed);
  int32_t evidence[kBlockVoxels];
  ReadOwnEvidence(map, block, evidence);
  ClassifyByEvidence(evidence, Surrounded(observed.any), out->states.data());
  out->shadow = {observed.any[13], observed.band, 0};
  out->sites.mask = {};
  if (observed.band == BlockMask{}) return;
  float mean[kHaloVoxels], weight[kHaloVoxels];
  map.ReadBand(block, mean, weight);
  const float h = static_cast<float>(map.voxel_size_m());
  out->shadow.band_hash = BandHash(mean, weight, observed.band);
  ExtractSites(mean, weight, h, min_weight, &out->sites);
  ClassifyBand(mean, weight, out->sites, h, min_weight, out->states.data());
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
