#include "server/integration/spherical_view.h"

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

constexpr float kHalfDiagonal = 0.8661f;  // of a unit cube

}  // namespace

SphericalView::SphericalView(const RangeImage& image, const Pose& T_W_X, double voxel_size_m,
                             double max_range_m)
    : image_(&image),
      pyramid_(image),
      h_(voxel_size_m),
      max_range_m_(static_cast<float>(max_range_m)),
      T_X_W_(T_W_X.inverse(Eigen::Isometry)),
      steps_X_(T_X_W_.linear().cast<float>() * static_cast<float>(voxel_size_m)) {}

SphericalView::Look SphericalView::LookAt(const Eigen::Vector3f& centre_X) const {
  const float h = static_cast<float>(h_);
  const float radius = kHalfDiagonal * kBlockSide * h;
  const float range_m = centre_X.norm(), across_m = centre_X.head<2>().norm();
  const float nearest_m = range_m - radius, nearest_across_m = across_m - radius;
  // Around the sensor and over its poles, directions spread too far to have a footprint.
  if (nearest_across_m < h || nearest_m > max_range_m_) return {};
  const float pixel = static_cast<float>(image_->pixel_rad());
  const float footprint = kHalfDiagonal * h / nearest_across_m / pixel + 1.f;
  Look look{Seen::kOpen, 1};
  while (static_cast<float>(1 << look.level) < footprint) ++look.level;
  if (look.level >= pyramid_.levels()) return {};

  const auto at = image_->Project(centre_X);
  if (!at) return look;
  const float du = std::asin(radius / across_m) / pixel + 2.f;
  const float dv = std::asin(radius / range_m) / pixel + 2.f;
  const bool whole = at->u - du >= 0.f && at->v - dv >= 0.f &&
                     at->u + du <= static_cast<float>(image_->width() - 1) &&
                     at->v + dv <= static_cast<float>(image_->height() - 1);
  if (!whole) return look;
  const RangePyramid::Bounds bounds =
      pyramid_.Over(static_cast<int>(at->u - du), static_cast<int>(std::ceil(at->u + du)),
                    static_cast<int>(at->v - dv), static_cast<int>(std::ceil(at->v + dv)));
  if (bounds.greatest < nearest_m) return {};
  if (bounds.least > range_m + radius && range_m + radius <= max_range_m_) look.seen = Seen::kFree;
  return look;
}

void SphericalView::ObserveConfident(FreeBlock& block) const {
  const Eigen::Vector3f first_X = (T_X_W_ * VoxelCentre(FirstVoxel(block.block), h_)).cast<float>();
  const Look look = LookAt(first_X + 3.5f * steps_X_.rowwise().sum());
  if (look.seen == Seen::kNever) return;
  if (look.seen == Seen::kFree) {
    block.confident = block.probable;
    return;
  }
  const float* dilated = pyramid_.dilated_least(look.level);
  const int stride = pyramid_.dilated_width(look.level);
  const float extent = kHalfDiagonal * static_cast<float>(h_);
  for (int x = 0; x < kBlockSide; ++x) {
    for (int y = 0; y < kBlockSide; ++y) {
      if (((block.probable[x] >> (8 * y)) & 0xff) == 0) continue;
      const RangeImage::EightProjections at =
          image_->ProjectEight(first_X + static_cast<float>(x) * steps_X_.col(0) +
                                   static_cast<float>(y) * steps_X_.col(1),
                               steps_X_.col(2));
      uint64_t sure = 0;
      for (int k = 0; k < 8; ++k) {
        const int cell = (at.v[k] >> look.level) * stride + (at.u[k] >> look.level);
        const float beyond = at.measure[k] + extent;
        sure |= static_cast<uint64_t>(at.inside[k] & (dilated[cell] > beyond) &
                                      (beyond <= max_range_m_))
                << k;
      }
      block.confident[x] |= (sure << (8 * y)) & block.probable[x];
    }
  }
}

}  // namespace clearance
