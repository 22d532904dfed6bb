#include "server/integration/label_rims.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

// Whether a pixel of an object has a neighbour that is not; the inside of an object needs no rim.
bool OnOutline(const RangeImage& image, int u, int v) {
  const uint16_t own = image.label(u, v);
  const auto differs = [&](int nu, int nv) {
    if (nu < 0 || nv < 0 || nu >= image.width() || nv >= image.height()) return image.wraps();
    return image.label(nu, nv) != own || !(image.measure(nu, nv) > 0.f);
  };
  return differs(u - 1, v) || differs(u + 1, v) || differs(u, v - 1) || differs(u, v + 1);
}

// One byte a pixel: static, and in the rim of an object. Empty where no object is seen.
std::vector<uint8_t> RimPixels(const RangeImage& image, int reach, float reach_m) {
  std::vector<uint8_t> rim;
  const RangeImage::PixelBox objects = image.BoxOfObjects();
  for (int v = objects.v0; v <= objects.v1; ++v) {
    for (int u = objects.u0; u <= objects.u1; ++u) {
      if (image.label(u, v) == 0 || !(image.measure(u, v) > 0.f)) continue;
      if (!OnOutline(image, u, v)) continue;
      if (rim.empty()) rim.resize(image.measures().size());
      const Eigen::Vector3f p_X = image.Point(u, v);
      for (int nv = std::max(0, v - reach); nv <= std::min(image.height() - 1, v + reach); ++nv) {
        for (int du = -reach; du <= reach; ++du) {
          int nu = u + du;
          if (image.wraps()) nu = (nu + image.width()) % image.width();
          if (nu < 0 || nu >= image.width() || image.label(nu, nv) != 0) continue;
          uint8_t& in_rim = rim[static_cast<size_t>(nv) * image.width() + nu];
          if (in_rim || !(image.measure(nu, nv) > 0.f)) continue;
          in_rim = (image.Point(nu, nv) - p_X).squaredNorm() <= reach_m * reach_m;
        }
      }
    }
  }
  return rim;
}

}  // namespace

std::vector<uint32_t> WithoutLabelRims(RangeImage& image, const Eigen::Matrix3Xf& points_X,
                                       std::vector<uint32_t> static_points,
                                       const RimOptions& options) {
  if (!image.has_labels()) return static_points;
  const int reach = image.is_pinhole()
                        ? options.pixels
                        : static_cast<int>(std::ceil(options.rim_rad / image.pixel_rad()));
  const std::vector<uint8_t> rim = RimPixels(image, reach, static_cast<float>(options.reach_m));
  if (rim.empty()) return static_points;
  for (size_t pixel = 0; pixel < rim.size(); ++pixel) {
    if (rim[pixel]) image.set_label(pixel, kRimLabel);
  }
  if (image.is_pinhole()) {  // columns are pixels
    std::erase_if(static_points, [&](uint32_t i) { return rim[i] != 0; });
    return static_points;
  }
  constexpr uint32_t kDropped = UINT32_MAX;
  tbb::parallel_for(tbb::blocked_range<size_t>(0, static_points.size(), 1 << 14),
                    [&](const tbb::blocked_range<size_t>& range) {
                      for (size_t i = range.begin(); i < range.end(); ++i) {
                        const auto at = image.Project(points_X.col(static_points[i]));
                        if (!at) continue;
                        const size_t pixel =
                            static_cast<size_t>(std::lround(at->v)) * image.width() +
                            static_cast<size_t>(std::lround(at->u));
                        if (rim[pixel]) static_points[i] = kDropped;
                      }
                    });
  std::erase(static_points, kDropped);
  return static_points;
}

}  // namespace clearance
