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

namespace {

std::array<Sight, kLanes> LookTowardsPinhole(const RangeImage& image,
                                             const std::array<Lanes, 3>& p_X, float voxel_size_m) {
  const int width = image.width(), height = image.height();
  const float* measures = image.measures().data();
  const Lanes z = p_X[2];
  const Lanes inverse = 1.f / Select(z > 0.f, z, Splat(1.f));
  const Lanes u = image.fx() * p_X[0] * inverse + image.cx();
  const Lanes v = image.fy() * p_X[1] * inverse + image.cy();
  const LanesInt inside = (z > 0.f) & (u > -0.5f) & (v > -0.5f) &
                          (u < static_cast<float>(width) - 0.5f) &
                          (v < static_cast<float>(height) - 0.5f);
  std::array<Sight, kLanes> sights{};
  if (Bits(inside) == 0) return sights;
  // Cutting off the fraction rounds; adding a half may have rounded up to the border.
  LanesInt column = __builtin_convertvector(Select(inside, u + 0.5f, Lanes{}), LanesInt);
  LanesInt row = __builtin_convertvector(Select(inside, v + 0.5f, Lanes{}), LanesInt);
  column = column > width - 1 ? LanesInt{} + (width - 1) : column;
  row = row > height - 1 ? LanesInt{} + (height - 1) : row;
  const LanesInt pixel = row * width + column;
  const Lanes middle = Gather(measures, pixel);
  const LanesInt usable = inside & (middle > 0.f);
  const Lanes beyond = z + 0.5f * voxel_size_m;
  LanesInt edge{};
  Lanes sum{}, used{};
  for (int dv = -1; dv <= 1; ++dv) {
    const LanesInt row_in = (row + dv >= 0) & (row + dv < height);
    for (int du = -1; du <= 1; ++du) {
      const LanesInt in = row_in & (column + du >= 0) & (column + du < width);
      const Lanes m = Gather(measures, in ? pixel + (dv * width + du) : pixel);
      edge |= in & ((m > beyond) | (m == 0.f));
      const Lanes off = m - middle;
      const LanesInt near = in & (m > 0.f) & (Max(off, -off) <= voxel_size_m);
      sum += Select(near, 1.f / m, Lanes{});
      used += Select(near, Splat(1.f), Lanes{});
    }
  }
  const Lanes in_front = used / sum - z;
  for (int k = 0; k < kLanes; ++k) {
    if (!usable[k]) continue;
    sights[k] = {true, in_front[k], image.label(column[k], row[k]), edge[k] != 0};
  }
  return sights;
}

}  // namespace

std::array<Sight, kLanes> LookTowards(const RangeImage& image, const std::array<Lanes, 3>& p_X,
                                      size_t count, float voxel_size_m) {
  if (image.is_pinhole()) return LookTowardsPinhole(image, p_X, voxel_size_m);
  std::array<Sight, kLanes> sights{};
  for (size_t k = 0; k < count; ++k) {
    sights[k] = LookTowards(image, Eigen::Vector3f(p_X[0][k], p_X[1][k], p_X[2][k]), voxel_size_m);
  }
  return sights;
}

}  // namespace clearance
