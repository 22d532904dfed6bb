// Eight floats at a time. The compiler's vector types, since its loop vectoriser must keep the
// order of floating-point comparisons and so gives up where a minimum is taken. One lane computes
// exactly what the same expression computes on a float.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#ifdef __AVX__
#include <immintrin.h>
#endif

namespace clearance {

typedef float Floats __attribute__((vector_size(32)));
typedef int32_t Ints __attribute__((vector_size(32)));

[[gnu::always_inline]] inline Floats LoadFloats(const float* at) {
  Floats v;
  std::memcpy(&v, at, sizeof(v));
  return v;
}
[[gnu::always_inline]] inline Floats AllOf(float x) { return Floats{x, x, x, x, x, x, x, x}; }

[[gnu::always_inline]] inline float LaneMax(float a, float b) { return a > b ? a : b; }
[[gnu::always_inline]] inline Floats LaneMax(Floats a, Floats b) { return a > b ? a : b; }
[[gnu::always_inline]] inline Floats LaneMin(Floats a, Floats b) { return a < b ? a : b; }

[[gnu::always_inline]] inline float LaneSqrt(float a) { return std::sqrt(a); }
[[gnu::always_inline]] inline Floats LaneSqrt(Floats a) {
#ifdef __AVX__
  return _mm256_sqrt_ps(a);
#else
  for (int i = 0; i < 8; ++i) a[i] = std::sqrt(a[i]);
  return a;
#endif
}

// Bit i set where lane i is at most the limit.
[[gnu::always_inline]] inline unsigned AtMost(Floats a, float limit) {
#ifdef __AVX__
  return static_cast<unsigned>(_mm256_movemask_ps(_mm256_cmp_ps(a, AllOf(limit), _CMP_LE_OQ)));
#else
  unsigned mask = 0;
  for (int i = 0; i < 8; ++i) mask |= static_cast<unsigned>(a[i] <= limit) << i;
  return mask;
#endif
}

// In a fixed order.
[[gnu::always_inline]] inline float SumOfLanes(Floats a) {
  return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]));
}

}  // namespace clearance
