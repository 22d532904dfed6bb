#include "server/esdf/site_references.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include <algorithm>

#include "server/esdf/sweep.h"
#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

// A site's voxel relative to the first voxel of the block that names it.
struct RelativeVoxel {
  int x, y, z;
  int Offset() const { return ((x & 7) << 6) | ((y & 7) << 3) | (z & 7); }
};

// Sites lie in [-128, 127] units about the centre of their own voxel.
RelativeVoxel SiteVoxel(int offset, const FieldVoxel& v) {
  return {(offset >> 6) + ((v.dx + 128) >> 8), ((offset >> 3) & 7) + ((v.dy + 128) >> 8),
          (offset & 7) + ((v.dz + 128) >> 8)};
}

// Key of a site's block relative to the block that names it: five bits an axis, -16..15, which is
// more than the 120 voxels that offsets reach. -1 without a site.
constexpr int32_t kNoKey = -1;

BlockIndex BlockOfKey(const BlockIndex& origin, int32_t key) {
  const auto part = [key](int shift) { return ((key >> shift & 31) ^ 16) - 16; };
  return {origin.x + part(0), origin.y + part(5), origin.z + part(10)};
}

// Keys of all voxels; consecutive voxels mostly share theirs.
void SiteKeys(const FieldBlock& block, int32_t keys[kBlockVoxels]) {
#if defined(__AVX2__)
  const __m256i along_z = _mm256_setr_epi16(0, 0, 0, 0, 0, 0, 256, 0, 0, 0, 512, 0, 0, 0, 768, 0);
  const __m256i bits = _mm256_set1_epi64x(0x0000001f001f001f);
  const __m256i places = _mm256_set1_epi64x(0x0000040000200001);
  const __m256i none = _mm256_set1_epi64x(0x8000), first = _mm256_set1_epi64x(0xffff);
  const __m256i even = _mm256_setr_epi32(0, 2, 4, 6, 0, 2, 4, 6);
  for (int o = 0; o < kBlockVoxels; o += 4) {
    const __m256i v = _mm256_load_si256(reinterpret_cast<const __m256i*>(&block.voxels[o]));
    const uint64_t position = uint64_t{static_cast<uint16_t>((o >> 6) * 256 + 128)} |
                              uint64_t{static_cast<uint16_t>(((o >> 3) & 7) * 256 + 128)} << 16 |
                              uint64_t{static_cast<uint16_t>((o & 7) * 256 + 128)} << 32;
    const __m256i at = _mm256_add_epi16(_mm256_add_epi16(v, along_z),
                                        _mm256_set1_epi64x(static_cast<int64_t>(position)));
    const __m256i parts = _mm256_and_si256(_mm256_srai_epi16(at, 11), bits);
    const __m256i sums = _mm256_madd_epi16(parts, places);
    const __m256i key = _mm256_add_epi32(sums, _mm256_shuffle_epi32(sums, 0xb1));
    const __m256i missing = _mm256_and_si256(_mm256_cmpeq_epi16(v, none), first);
    const __m256i spread = _mm256_srai_epi32(_mm256_slli_epi32(missing, 16), 16);
    const __m256i packed = _mm256_permutevar8x32_epi32(_mm256_or_si256(key, spread), even);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(keys + o), _mm256_castsi256_si128(packed));
  }
#else
  for (int o = 0; o < kBlockVoxels; ++o) {
    const FieldVoxel& v = block.voxels[o];
    const RelativeVoxel u = SiteVoxel(o, v);
    const int32_t key = (u.x >> 3 & 31) | (u.y >> 3 & 31) << 5 | (u.z >> 3 & 31) << 10;
    keys[o] = v.has_site() ? key : kNoKey;
  }
#endif
}

// Calls fn(offset, voxel, site voxel, site block) for each voxel whose site is in gone() of one of
// `changed`, until fn returns false.
template <typename Block, typename Fn>
void ForEachNamingGone(const BlockIndex& index, Block& block, const ChangedSites& changed,
                       const Fn& fn) {
  int32_t keys[kBlockVoxels];
  SiteKeys(block, keys);
  int32_t last_key = kNoKey;
  const SiteBlock* last = nullptr;
  for (int o = 0; o < kBlockVoxels; ++o) {
    if (keys[o] != last_key) {
      last_key = keys[o];
      last = nullptr;
      if (last_key == kNoKey) continue;
      const BlockIndex site_block = BlockOfKey(index, last_key);
      for (const SiteBlock* s : changed) {
        if (s->index() == site_block) last = s;
      }
    }
    if (!last) continue;
    auto& v = block.voxels[o];
    const RelativeVoxel u = SiteVoxel(o, v);
    if (Test(last->gone(), u.Offset()) && !fn(o, v, u, *last)) return;
  }
}

}  // namespace

ReferencedBlockList ReferencedBlocks(const BlockIndex& index, const FieldBlock& block) {
  int32_t keys[kBlockVoxels];
  SiteKeys(block, keys);
  absl::InlinedVector<int32_t, 16> found;
  int32_t last = kNoKey;
  for (int row = 0; row < kBlockVoxels; row += kBlockSide) {
    int32_t differs = 0;  // most rows name one block, the same as the row before
    for (int z = 0; z < kBlockSide; ++z) differs |= keys[row + z] ^ last;
    if (differs == 0) continue;
    for (int z = 0; z < kBlockSide; ++z) {
      const int32_t key = keys[row + z];
      if (key == last) continue;
      last = key;
      if (key == kNoKey || std::find(found.begin(), found.end(), key) != found.end()) continue;
      found.push_back(key);
    }
  }
  ReferencedBlockList blocks;
  for (int32_t key : found) blocks.push_back(BlockOfKey(index, key));
  return blocks;
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
