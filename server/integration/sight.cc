#include "server/integration/sight.h"

#include <cmath>

namespace clearance {

Sight LookTowards(const RangeImage& image, const Eigen::Vector3f& p_X, float voxel_size_m) {
  Sight sight;
  const auto at = image.Project(p_X);
  if (!at) return sight;
  const int u = static_cast<int>(std::lround(at->u)), v = static_cast<int>(std::lround(at->v));
  const float middle = image.measure(u, v);
  if (!(middle > 0)) return sight;
  sight.usable = true;
  sight.label = image.label(u, v);
  const float beyond = at->measure + 0.5f * voxel_size_m;
  // Of a plane's pinhole image the reciprocal is linear in u and v, so that its mean is unbiased.
  float sum = 0, count = 0;
  for (int dv = -1; dv <= 1; ++dv) {
    if (v + dv < 0 || v + dv >= image.height()) continue;
    for (int du = -1; du <= 1; ++du) {
      int un = u + du;
      if (image.wraps()) un = (un + image.width()) % image.width();
      if (un < 0 || un >= image.width()) continue;
      const float m = image.measure(un, v + dv);
      if (m > beyond || (m == 0 && image.is_pinhole())) sight.edge_beyond = true;
      if (!(m > 0) || std::abs(m - middle) > voxel_size_m) continue;
      sum += 1.f / m;
      count += 1;
    }
  }
  sight.in_front_m = count / sum - at->measure;
  return sight;
}

}  // namespace clearance
