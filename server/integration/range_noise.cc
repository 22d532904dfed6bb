#include "server/integration/range_noise.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace clearance {

double EstimateNoise(const RangeImage& image) {
  if (!image.is_pinhole()) return 0;
  constexpr int kRowStep = 5, kColumnStep = 7;
  constexpr size_t kFewest = 100;
  std::vector<float> residual_m;
  for (int v = 0; v < image.height(); v += kRowStep) {
    for (int u = 1; u + 1 < image.width(); u += kColumnStep) {
      if (!image.has_surface(u - 1, v) || !image.has_surface(u, v) ||
          !image.has_surface(u + 1, v)) {
        continue;
      }
      const float m = image.measure(u, v);
      const float second = 1.f / image.measure(u - 1, v) - 2.f / m + 1.f / image.measure(u + 1, v);
      residual_m.push_back(std::abs(second) * m * m);
    }
  }
  if (residual_m.size() < kFewest) return 0;
  const auto middle = residual_m.begin() + residual_m.size() / 2;
  std::nth_element(residual_m.begin(), middle, residual_m.end());
  // The median of |x| is 0.6745 sigma; a second difference has 1 + 4 + 1 times the variance.
  return *middle / (0.6745 * std::sqrt(6.0));
}

}  // namespace clearance
