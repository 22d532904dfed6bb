#include "server/esdf/sweep.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include <cmath>
#include <cstring>

#include "server/esdf/voxel_state.h"

namespace clearance {
namespace {

static_assert(FieldVoxel::kNoSite == INT16_MIN);

// Four voxels at a time. A voxel is one 64-bit lane: dx, dy, dz, attributes. Squared lengths are
// kept beside it, twice in the lane, so that comparing them gives a mask for the whole voxel.
constexpr int kLanes = 4;

#if defined(__AVX2__)

struct Quad {
  __m256i v;
  static Quad Load(const void* p) { return {_mm256_load_si256(static_cast<const __m256i*>(p))}; }
  void Store(void* p) const { _mm256_store_si256(static_cast<__m256i*>(p), v); }
};

Quad AddShift(Quad a, uint64_t shift) {
  return {_mm256_add_epi16(a.v, _mm256_set1_epi64x(static_cast<int64_t>(shift)))};
}

Quad SquaredLength(Quad a) {
  const __m256i xyz = _mm256_and_si256(a.v, _mm256_set1_epi64x(0x0000ffffffffffff));
  const __m256i pairs = _mm256_madd_epi16(xyz, xyz);
  return {_mm256_add_epi32(pairs, _mm256_shuffle_epi32(pairs, 0xb1))};
}

Quad Less(Quad a, Quad b) { return {_mm256_cmpgt_epi32(b.v, a.v)}; }
Quad Min(Quad a, Quad b) { return {_mm256_min_epi32(a.v, b.v)}; }
Quad Or(Quad a, Quad b) { return {_mm256_or_si256(a.v, b.v)}; }
Quad And(Quad a, uint64_t mask) {
  return {_mm256_and_si256(a.v, _mm256_set1_epi64x(static_cast<int64_t>(mask)))};
}
Quad Select(Quad mask, Quad yes, Quad no) { return {_mm256_blendv_epi8(no.v, yes.v, mask.v)}; }
bool Any(Quad a) { return !_mm256_testz_si256(a.v, a.v); }
Quad Both(int32_t value) { return {_mm256_set1_epi32(value)}; }
Quad Zero() { return {_mm256_setzero_si256()}; }

// 4 x 4 voxels in rows of 8; `to` may be `from`.
void TransposeQuads(const uint64_t* from, uint64_t* to) {
  const __m256i r0 = Quad::Load(from).v, r1 = Quad::Load(from + 8).v;
  const __m256i r2 = Quad::Load(from + 16).v, r3 = Quad::Load(from + 24).v;
  const __m256i a = _mm256_unpacklo_epi64(r0, r1), b = _mm256_unpackhi_epi64(r0, r1);
  const __m256i c = _mm256_unpacklo_epi64(r2, r3), d = _mm256_unpackhi_epi64(r2, r3);
  Quad{_mm256_permute2x128_si256(a, c, 0x20)}.Store(to);
  Quad{_mm256_permute2x128_si256(b, d, 0x20)}.Store(to + 8);
  Quad{_mm256_permute2x128_si256(a, c, 0x31)}.Store(to + 16);
  Quad{_mm256_permute2x128_si256(b, d, 0x31)}.Store(to + 24);
}

#else

struct Quad {
  std::array<uint64_t, kLanes> v;
  static Quad Load(const void* p) {
    Quad out;
    std::memcpy(out.v.data(), p, sizeof(out.v));
    return out;
  }
  void Store(void* p) const { std::memcpy(p, v.data(), sizeof(v)); }
};

template <typename Fn>
Quad Map(const Fn& fn) {
  Quad out;
  for (int i = 0; i < kLanes; ++i) out.v[i] = fn(i);
  return out;
}
int16_t Part(uint64_t v, int i) { return static_cast<int16_t>(v >> (16 * i)); }
uint64_t Twice(int32_t s) { return uint64_t{static_cast<uint32_t>(s)} * 0x100000001ull; }

Quad AddShift(Quad a, uint64_t shift) {
  return Map([&](int i) {
    uint64_t out = 0;
    for (int k = 0; k < 4; ++k) {
      const int sum = Part(a.v[i], k) + Part(shift, k);
      out |= uint64_t{static_cast<uint16_t>(sum)} << (16 * k);
    }
    return out;
  });
}
Quad SquaredLength(Quad a) {
  return Map([&](int i) {
    int32_t sum = 0;
    for (int k = 0; k < 3; ++k) sum += int32_t{Part(a.v[i], k)} * Part(a.v[i], k);
    return Twice(sum);
  });
}
int32_t Low(uint64_t v) { return static_cast<int32_t>(v); }
Quad Less(Quad a, Quad b) {
  return Map([&](int i) { return Low(a.v[i]) < Low(b.v[i]) ? ~uint64_t{0} : 0; });
}
Quad Min(Quad a, Quad b) {
  return Map([&](int i) { return Low(a.v[i]) < Low(b.v[i]) ? a.v[i] : b.v[i]; });
}
Quad Or(Quad a, Quad b) {
  return Map([&](int i) { return a.v[i] | b.v[i]; });
}
Quad And(Quad a, uint64_t mask) {
  return Map([&](int i) { return a.v[i] & mask; });
}
Quad Select(Quad mask, Quad yes, Quad no) {
  return Map([&](int i) { return (yes.v[i] & mask.v[i]) | (no.v[i] & ~mask.v[i]); });
}
bool Any(Quad a) { return (a.v[0] | a.v[1] | a.v[2] | a.v[3]) != 0; }
Quad Both(int32_t value) {
  return Map([&](int) { return Twice(value); });
}
Quad Zero() { return {}; }

void TransposeQuads(const uint64_t* from, uint64_t* to) {
  uint64_t out[4][4];
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) out[j][i] = from[i * 8 + j];
  }
  for (int i = 0; i < 4; ++i) std::memcpy(to + i * 8, out[i], sizeof(out[i]));
}

#endif

// Lane mask that keeps the vector and the site's attributes.
constexpr uint64_t kSiteLane = 0x0000ffffffffffffull | uint64_t{kSiteBits} << 48;

// What must be added to a site vector when the voxel it belongs to moves by `step` along an axis.
constexpr uint64_t Shift(int axis, int step) {
  return uint64_t{static_cast<uint16_t>(-256 * step)} << (16 * axis);
}

// v and its squared lengths q, [a][b][c] with c contiguous.
struct Lines {
  alignas(64) uint64_t v[kBlockVoxels];
  alignas(64) uint64_t q[kBlockVoxels];

  // Offers `candidate` to the four voxels at i.
  Quad Offer(int i, Quad candidate) {
    const Quad length = SquaredLength(candidate), current = Quad::Load(q + i);
    const Quad better = Less(length, current);
    Select(better, candidate, Quad::Load(v + i)).Store(v + i);
    Min(length, current).Store(q + i);
    return better;
  }

  // Scans along a (kStride 64) or b (kStride 8), forwards and backwards; the 16 groups of a slice
  // are independent of each other.
  template <int kStride>
  bool Scan(int axis) {
    constexpr int kOuter = kStride == 64 ? 8 : 64;  // steps between rows of a slice
    Quad any = Zero();
    for (int s = 1; s < 8; ++s) {
      for (int row = 0; row < 8; ++row) {
        const int i = s * kStride + row * kOuter;
        for (int half = 0; half < 8; half += kLanes) {
          const Quad from = Quad::Load(v + i - kStride + half);
          any = Or(any, Offer(i + half, AddShift(from, Shift(axis, 1))));
        }
      }
    }
    for (int s = 6; s >= 0; --s) {
      for (int row = 0; row < 8; ++row) {
        const int i = s * kStride + row * kOuter;
        for (int half = 0; half < 8; half += kLanes) {
          const Quad from = Quad::Load(v + i + kStride + half);
          any = Or(any, Offer(i + half, AddShift(from, Shift(axis, -1))));
        }
      }
    }
    return Any(any);
  }
};

// [a][b][c] -> [a][c][b], 4 x 4 voxels at a time.
void Transpose(uint64_t* data) {
  for (int a = 0; a < 8; ++a) {
    uint64_t* m = data + a * 64;
    TransposeQuads(m, m);
    TransposeQuads(m + 36, m + 36);
    alignas(64) uint64_t corner[32];
    for (int b = 0; b < 4; ++b) Quad::Load(m + b * 8 + 4).Store(corner + b * 8);
    TransposeQuads(m + 32, m + 4);
    TransposeQuads(corner, m + 32);
  }
}

// Gathers the layer of a block that touches face `face` of its neighbour's side: 64 voxels, the
// two remaining axes in order.
void ReadLayer(const void* block, int face, uint64_t out[64]) {
  constexpr size_t kVoxel = sizeof(uint64_t);
  const char* first = static_cast<const char*>(block);
  const int fixed = face & 1 ? 7 : 0;
  switch (face >> 1) {
    case 0:
      std::memcpy(out, first + fixed * 64 * kVoxel, 64 * kVoxel);
      return;
    case 1:
      for (int x = 0; x < 8; ++x) {
        std::memcpy(out + x * 8, first + (x * 64 + fixed * 8) * kVoxel, 8 * kVoxel);
      }
      return;
    default:
      for (int i = 0; i < 64; ++i) std::memcpy(out + i, first + (i * 8 + fixed) * kVoxel, kVoxel);
  }
}

// Whether the sites of a layer are not those that the block still holds there.
bool LayerDiffers(const uint64_t now[64], const void* block, int face) {
  alignas(64) uint64_t before[64];
  ReadLayer(block, face, before);
  uint64_t differs = 0;
  for (int i = 0; i < 64; ++i) differs |= (now[i] ^ before[i]) & kSiteLane;
  return differs != 0;
}

}  // namespace

int32_t SquaredLimit(double max_distance_m, double voxel_size_m) {
  const double units = max_distance_m / voxel_size_m * 256.0;
  return static_cast<int32_t>(std::floor(units * units));
}

SweepResult SweepBlock(const std::array<const FieldBlock*, kFaces>& neighbours,
                       int32_t squared_limit, FieldBlock* block, uint8_t faces) {
  Lines lines;
  static_assert(sizeof(lines.v) == sizeof(block->voxels));
  FieldVoxel* own = block->voxels.data();
  const Quad beyond = Both(squared_limit + 1);
  for (int i = 0; i < kBlockVoxels; i += kLanes) {
    const Quad v = And(Quad::Load(own + i), kSiteLane);
    v.Store(lines.v + i);
    Min(SquaredLength(v), beyond).Store(lines.q + i);
  }
  alignas(64) uint64_t layer[kFaces][64];
  Quad any = Zero();
  for (int f = 0; f < kFaces; ++f) {
    if (!neighbours[f] || !(faces >> f & 1)) continue;
    ReadLayer(neighbours[f]->voxels.data(), f ^ 1, layer[f]);
    const int axis = f >> 1;
    const uint64_t shift = Shift(axis, f & 1 ? -1 : 1);
    const int fixed = f & 1 ? 7 : 0;
    if (axis == 2) {
      alignas(64) uint64_t v[64], q[64];
      ReadLayer(lines.v, f, v);
      ReadLayer(lines.q, f, q);
      for (int i = 0; i < 64; i += kLanes) {
        const Quad candidate = AddShift(And(Quad::Load(layer[f] + i), kSiteLane), shift);
        const Quad length = SquaredLength(candidate), current = Quad::Load(q + i);
        const Quad better = Less(length, current);
        any = Or(any, better);
        Select(better, candidate, Quad::Load(v + i)).Store(v + i);
        Min(length, current).Store(q + i);
      }
      for (int i = 0; i < 64; ++i) {
        lines.v[i * 8 + fixed] = v[i];
        lines.q[i * 8 + fixed] = q[i];
      }
      continue;
    }
    for (int row = 0; row < 8; ++row) {
      const int i = axis == 0 ? fixed * 64 + row * 8 : row * 64 + fixed * 8;
      for (int half = 0; half < 8; half += kLanes) {
        const Quad candidate = And(Quad::Load(layer[f] + row * 8 + half), kSiteLane);
        any = Or(any, lines.Offer(i + half, AddShift(candidate, shift)));
      }
    }
  }
  bool changed = Any(any);
  // An axis is settled until another one changes something: stop after three settled in a row.
  for (int settled = 0, axis = 0; settled < 3; axis = (axis + 1) % 3) {
    bool improved;
    if (axis == 0) {
      improved = lines.Scan<64>(0);
    } else if (axis == 1) {
      improved = lines.Scan<8>(1);
    } else {
      Transpose(lines.v);
      Transpose(lines.q);
      improved = lines.Scan<8>(2);
      Transpose(lines.v);
      Transpose(lines.q);
    }
    settled = improved ? 1 : settled + 1;
    changed |= improved;
  }
  SweepResult result;
  result.changed = changed;
  alignas(64) uint64_t mine[64];
  for (int f = 0; f < kFaces; ++f) {
    ReadLayer(lines.v, f, mine);
    if (!(faces >> f & 1)) {
      if (!changed || !LayerDiffers(mine, own, f)) continue;
      if (neighbours[f]) ReadLayer(neighbours[f]->voxels.data(), f ^ 1, layer[f]);
    }
    const uint64_t shift = Shift(f >> 1, f & 1 ? 1 : -1);
    Quad wakes = Zero();
    for (int i = 0; i < 64; i += kLanes) {
      const Quad length = SquaredLength(AddShift(Quad::Load(mine + i), shift));
      Quad theirs = beyond;
      if (neighbours[f]) theirs = Min(SquaredLength(Quad::Load(layer[f] + i)), beyond);
      wakes = Or(wakes, Less(length, theirs));
    }
    if (Any(wakes)) result.wake |= 1 << f;
  }
  if (changed) {
    for (int i = 0; i < kBlockVoxels; i += kLanes) {
      const Quad bits = And(Quad::Load(own + i), ~kSiteLane);
      Or(Quad::Load(lines.v + i), bits).Store(own + i);
    }
  }
  return result;
}

}  // namespace clearance
