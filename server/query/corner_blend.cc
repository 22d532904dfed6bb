#include "server/query/corner_blend.h"

#ifdef __AVX__
#include <immintrin.h>
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "server/query/lanes.h"

namespace clearance {
namespace {

// Nearer than this the blend of surfels alone counts, beyond the second bound the sites alone.
// Measured on planes, spheres, boxes, corners and poles: mean error 0.01 to 0.05 voxel.
constexpr float kBlendOnlyVoxels = 1.5f;
constexpr float kSitesOnlyVoxels = 2.5f;
// A disc's radius shrinks with the centre's distance, so that the coarse normals do not tilt it.
constexpr float kDiscRadiusVoxels = 0.5f;
constexpr float kFullDiscVoxels = 1.f;
constexpr float kNoDiscVoxels = 3.f;
constexpr float kNowhere = 1e30f;

constexpr Floats kCornerX = {0, 0, 0, 0, 1, 1, 1, 1};
constexpr Floats kCornerY = {0, 0, 1, 1, 0, 0, 1, 1};
constexpr Floats kCornerZ = {0, 1, 0, 1, 0, 1, 0, 1};
constexpr Floats kSideX = {-1, -1, -1, -1, 1, 1, 1, 1};
constexpr Floats kSideY = {-1, -1, 1, 1, -1, -1, 1, 1};
constexpr Floats kSideZ = {-1, 1, -1, 1, -1, 1, -1, 1};

struct NormalTable {
  alignas(64) float xyz[128][4];
  NormalTable() {
    for (int code = 0; code < 128; ++code) {
      const Eigen::Vector3f n = NormalOfCode(code);
      for (int axis = 0; axis < 3; ++axis) xyz[code][axis] = n[axis];
      xyz[code][3] = 0;
    }
  }
};
const NormalTable& Normals() {
  static const NormalTable table;
  return table;
}

// Vectors from the voxel centres (d) and from the point (e) to the centres' sites, in voxels.
struct Corners {
  Floats dx, dy, dz;
  Floats ex, ey, ez;
  Floats squared;  // |e|^2, kNowhere without a site
  Ints attributes;

  Floats Signed(Floats distance) const { return (attributes & 8) != 0 ? -distance : distance; }
};

// The voxels' lower and upper halves: dx and dy, dz and attributes.
struct Halves {
  Ints low, high;
};
[[gnu::always_inline]] inline Halves Split(const FieldVoxel voxels[8]) {
  Halves halves;
#ifdef __AVX2__
  // By pairs, as they were written: a wider read would wait for them to reach the cache.
  const auto pair = [&](int k) {
    return _mm_loadu_si128(reinterpret_cast<const __m128i*>(voxels + k));
  };
  const __m256 front = _mm256_castsi256_ps(_mm256_set_m128i(pair(4), pair(0)));
  const __m256 back = _mm256_castsi256_ps(_mm256_set_m128i(pair(6), pair(2)));
  halves.low = reinterpret_cast<Ints>(_mm256_shuffle_ps(front, back, 0b10001000));
  halves.high = reinterpret_cast<Ints>(_mm256_shuffle_ps(front, back, 0b11011101));
#else
  uint64_t words[8];
  std::memcpy(words, voxels, sizeof(words));
  for (int k = 0; k < 8; ++k) halves.low[k] = static_cast<int32_t>(words[k]);
  for (int k = 0; k < 8; ++k) halves.high[k] = static_cast<int32_t>(words[k] >> 32);
#endif
  return halves;
}

[[gnu::always_inline]] inline Corners Unpack(const FieldVoxel voxels[8], const float f[3]) {
  const auto [low, high] = Split(voxels);
  const Ints ix = (low << 16) >> 16;
  Corners c;
  c.attributes = (high >> 16) & 0xffff;
  c.dx = __builtin_convertvector(ix, Floats) * FieldVoxel::kUnit;
  c.dy = __builtin_convertvector(low >> 16, Floats) * FieldVoxel::kUnit;
  c.dz = __builtin_convertvector((high << 16) >> 16, Floats) * FieldVoxel::kUnit;
  c.ex = c.dx + (kCornerX - f[0]);
  c.ey = c.dy + (kCornerY - f[1]);
  c.ez = c.dz + (kCornerZ - f[2]);
  const Floats squared = c.ex * c.ex + c.ey * c.ey + c.ez * c.ez;
  c.squared = ix == static_cast<int32_t>(FieldVoxel::kNoSite) ? AllOf(kNowhere) : squared;
  return c;
}

// Trilinear weights and their derivatives.
struct Trilinear {
  Floats w, wx, wy, wz;
};
[[gnu::always_inline]] inline Trilinear WeightsAt(const float f[3]) {
  const Floats ax = (1.f - kCornerX) + kSideX * f[0];
  const Floats ay = (1.f - kCornerY) + kSideY * f[1];
  const Floats az = (1.f - kCornerZ) + kSideZ * f[2];
  return {ax * ay * az, kSideX * ay * az, ax * kSideY * az, ax * ay * kSideZ};
}

// Signed distance of each centre to its surfel.
[[gnu::always_inline]] inline Floats SurfelDistances(const FieldVoxel voxels[8], const Corners& c) {
  Floats nx, ny, nz;
  const NormalTable& table = Normals();
#ifdef __AVX__
  const auto two = [&](int k) {
    return _mm256_set_m128(_mm_load_ps(table.xyz[voxels[k + 4].normal_code()]),
                           _mm_load_ps(table.xyz[voxels[k].normal_code()]));
  };
  const __m256 n0 = two(0), n1 = two(1), n2 = two(2), n3 = two(3);
  const __m256 xy01 = _mm256_unpacklo_ps(n0, n1), xy23 = _mm256_unpacklo_ps(n2, n3);
  const __m256 z01 = _mm256_unpackhi_ps(n0, n1), z23 = _mm256_unpackhi_ps(n2, n3);
  nx = _mm256_shuffle_ps(xy01, xy23, 0b01000100);
  ny = _mm256_shuffle_ps(xy01, xy23, 0b11101110);
  nz = _mm256_shuffle_ps(z01, z23, 0b01000100);
#else
  for (int k = 0; k < 8; ++k) {
    const float* n = table.xyz[voxels[k].normal_code()];
    nx[k] = n[0];
    ny[k] = n[1];
    nz[k] = n[2];
  }
#endif
  const Floats squared = c.dx * c.dx + c.dy * c.dy + c.dz * c.dz;
  const Floats height = nx * c.dx + ny * c.dy + nz * c.dz;
  const Floats fade = (kNoDiscVoxels - LaneSqrt(squared)) / (kNoDiscVoxels - kFullDiscVoxels);
  const Floats radius = kDiscRadiusVoxels * LaneMin(AllOf(1), LaneMax(AllOf(0), fade));
  const Floats lateral = LaneSqrt(LaneMax(AllOf(0), squared - height * height));
  const Floats beyond = LaneMax(AllOf(0), lateral - radius);
  return c.Signed(LaneSqrt(height * height + beyond * beyond));
}

Eigen::Vector3f UnitOrZero(const Eigen::Vector3f& v) {
  const float norm = v.norm();
  return norm > 1e-6f ? Eigen::Vector3f(v / norm) : Eigen::Vector3f::Zero();
}

// Where the centres disagree about the side: the sign of the blended distance to the sites.
bool BlendedSideIsNegative(const Corners& c, const float f[3]) {
  const Floats d = c.Signed(LaneSqrt(c.dx * c.dx + c.dy * c.dy + c.dz * c.dz));
  return SumOfLanes(c.squared < kNowhere ? WeightsAt(f).w * d : AllOf(0)) < 0;
}

// The first lane that holds the smallest value.
[[gnu::always_inline]] inline int SmallestLane(Floats a) {
#ifdef __AVX__
  __m256 least = _mm256_min_ps(a, _mm256_permute2f128_ps(a, a, 1));
  least = _mm256_min_ps(least, _mm256_permute_ps(least, 0b01001110));
  least = _mm256_min_ps(least, _mm256_permute_ps(least, 0b10110001));
  const int equal = _mm256_movemask_ps(_mm256_cmp_ps(a, least, _CMP_EQ_OQ));
  return std::countr_zero(static_cast<unsigned>(equal));
#else
  int best = 0;
  for (int k = 1; k < 8; ++k) best = a[k] < a[best] ? k : best;
  return best;
#endif
}

}  // namespace

void BlendCorners(const FieldVoxel voxels[8], const float fraction[3], StaticAnswer* answer) {
  const Corners c = Unpack(voxels, fraction);
  const int best = SmallestLane(c.squared);
  const float squared = c.squared[best];
  answer->has_site = squared < kNowhere;
  if (!answer->has_site) {
    answer->gradient_W.setZero();
    answer->distance_voxels = 0;
    return;
  }
  answer->sigma_code = static_cast<uint8_t>((c.attributes[best] >> 4) & 31);
  const float to_site = std::sqrt(squared);
  const Eigen::Vector3f towards(c.ex[best], c.ey[best], c.ez[best]);

  // Without a site a lane is kNowhere.
  const bool every_site = to_site < kSitesOnlyVoxels && AtMost(c.squared, 0.5f * kNowhere) == 0xff;
  if (every_site) {
    const Trilinear blend = WeightsAt(fraction);
    const Floats distance = SurfelDistances(voxels, c);
    const float blended = SumOfLanes(blend.w * distance);
    const Eigen::Vector3f slope =
        UnitOrZero({SumOfLanes(blend.wx * distance), SumOfLanes(blend.wy * distance),
                    SumOfLanes(blend.wz * distance)});
    if (to_site <= kBlendOnlyVoxels) {
      answer->distance_voxels = blended;
      answer->gradient_W = slope;
      return;
    }
    // Surfaces farther than 1.5 voxels cannot cross the cell: here a change of side between the
    // centres is a border of knowledge, and the blended sign is as good as any.
    const float share = (kSitesOnlyVoxels - to_site) / (kSitesOnlyVoxels - kBlendOnlyVoxels);
    const float sign = blended < 0 ? -1.f : 1.f;
    answer->distance_voxels = share * blended + (1 - share) * sign * to_site;
    answer->gradient_W = UnitOrZero(share * slope - (1 - share) * sign / to_site * towards);
    return;
  }
  uint16_t all = 8, any = 0;
  for (int k = 0; k < 8; ++k) {
    all &= voxels[k].attributes;
    any |= voxels[k].attributes;
  }
  const bool negative = (any & 8) && ((all & 8) || BlendedSideIsNegative(c, fraction));
  const float sign = negative ? -1.f : 1.f;
  answer->distance_voxels = sign * to_site;
  answer->gradient_W = to_site > 1e-6f
                           ? Eigen::Vector3f(towards * (-sign / to_site))
                           : Eigen::Vector3f(sign * NormalOfCode((c.attributes[best] >> 9) & 127));
}

}  // namespace clearance
