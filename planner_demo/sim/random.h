#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace clearance::sim {

// A small generator (SplitMix64) whose numbers are the same with every standard library, so that a
// seed names one scene for good.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  // An independent generator for item `index` of this seed, whatever was drawn before.
  static Random ForItem(uint64_t seed, uint64_t stream, uint64_t index) {
    Random mixed(seed ^ (stream * 0x9e3779b97f4a7c15ULL));
    mixed.state_ = mixed.Bits() ^ (index * 0xbf58476d1ce4e5b9ULL);
    mixed.Bits();
    return mixed;
  }

  uint64_t Bits() {
    uint64_t z = (state_ += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }

  // Uniform in [low, high).
  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(Bits() >> 11) * 0x1p-53;
  }

  // Uniform in 0 .. count - 1; count > 0.
  int Index(int count) { return static_cast<int>(Bits() % static_cast<uint64_t>(count)); }

  double Normal(double sigma) {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform(0.0, 1.0)));
    return sigma * radius * std::cos(2.0 * std::numbers::pi * Uniform(0.0, 1.0));
  }

 private:
  uint64_t state_;
};

}  // namespace clearance::sim
