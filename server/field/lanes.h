// Eight floats side by side: one lane each for eight neighbourhoods, or eight points of one.
#pragma once

#ifdef __AVX__
#include <immintrin.h>
#endif

#include <cmath>
#include <cstdint>

namespace clearance {

inline constexpr int kLanes = 8;
typedef float Lanes __attribute__((vector_size(kLanes * sizeof(float))));
typedef int32_t LanesInt __attribute__((vector_size(kLanes * sizeof(int32_t))));

inline Lanes Splat(float a) { return Lanes{} + a; }

inline Lanes Select(LanesInt condition, Lanes yes, Lanes no) { return condition ? yes : no; }
inline Lanes Max(Lanes a, Lanes b) { return Select(a > b, a, b); }

// One bit a lane of a comparison's result.
inline uint32_t Bits(LanesInt condition) {
#ifdef __AVX__
  __m256 mask;
  __builtin_memcpy(&mask, &condition, sizeof(mask));
  return static_cast<uint32_t>(_mm256_movemask_ps(mask));
#else
  uint32_t bits = 0;
  for (int k = 0; k < kLanes; ++k) bits |= (condition[k] & 1u) << k;
  return bits;
#endif
}

inline Lanes Load(const float* from) {
  Lanes out;
  __builtin_memcpy(&out, from, sizeof(out));
  return out;
}

inline Lanes Gather(const float* from, LanesInt index) {
  Lanes out;
  for (int k = 0; k < kLanes; ++k) out[k] = from[index[k]];
  return out;
}

inline Lanes Sqrt(Lanes a) {
#ifdef __AVX__
  __m256 value;
  __builtin_memcpy(&value, &a, sizeof(value));
  value = _mm256_sqrt_ps(value);
  __builtin_memcpy(&a, &value, sizeof(value));
  return a;
#else
  Lanes out;
  for (int k = 0; k < kLanes; ++k) out[k] = std::sqrt(a[k]);
  return out;
#endif
}

inline Lanes Floor(Lanes a) {
#ifdef __AVX__
  __m256 value;
  __builtin_memcpy(&value, &a, sizeof(value));
  value = _mm256_floor_ps(value);
  __builtin_memcpy(&a, &value, sizeof(value));
  return a;
#else
  Lanes out;
  for (int k = 0; k < kLanes; ++k) out[k] = std::floor(a[k]);
  return out;
#endif
}

// exp(x) for x <= 0 to 2e-7 relative; exactly 0 below -80, so that padding far away adds nothing.
inline Lanes ExpOfNegative(Lanes x) {
  const LanesInt vanishes = x < -80.f;
  const Lanes y = Select(vanishes, Splat(0.f), x);
  // x = n ln 2 + r with |r| <= ln 2 / 2; ln 2 in two parts keeps r exact.
  const LanesInt n = __builtin_convertvector(y * 1.44269504f - 0.5f, LanesInt);
  const Lanes n_float = __builtin_convertvector(n, Lanes);
  const Lanes r = (y - n_float * 0.693359375f) - n_float * -2.12194440e-4f;
  Lanes p = Splat(1.f / 720);
  p = p * r + 1.f / 120;
  p = p * r + 1.f / 24;
  p = p * r + 1.f / 6;
  p = p * r + 0.5f;
  p = p * r + 1.f;
  p = p * r + 1.f;
  const LanesInt scale_bits = (n + 127) << 23;  // 2^n
  Lanes scale;
  __builtin_memcpy(&scale, &scale_bits, sizeof(scale));
  return Select(vanishes, Splat(0.f), p * scale);
}

}  // namespace clearance
