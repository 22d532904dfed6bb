#include "server/integration/pinhole_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace clearance {
namespace {

constexpr int kSuperSide = 4;  // blocks: the first, coarse cull

}  // namespace

PinholeView::PinholeView(const RangeImage& image, const Pose& T_W_X, double voxel_size_m,
                         double max_depth_m)
    : image_(&image),
      pyramid_(image),
      h_(voxel_size_m),
      T_W_X_(T_W_X),
      T_X_W_(T_W_X.inverse(Eigen::Isometry)),
      R_X_W_(T_X_W_.linear().cast<float>()),
      half_extent_X_(static_cast<float>(0.5 * voxel_size_m) * R_X_W_.cwiseAbs().rowwise().sum()) {
  const float farthest = pyramid_.Over(0, image.width() - 1, 0, image.height() - 1).greatest;
  max_depth_m_ = std::min(static_cast<float>(max_depth_m), farthest);
}

float PinholeView::max_slope_u() const {
  return std::max(image_->cx() + 0.5f, image_->width() - 0.5f - image_->cx()) / image_->fx();
}

float PinholeView::max_slope_v() const {
  return std::max(image_->cy() + 0.5f, image_->height() - 0.5f - image_->cy()) / image_->fy();
}

Eigen::Vector3f PinholeView::FirstCentre(const BlockIndex& block) const {
  return (T_X_W_ * VoxelCentre(FirstVoxel(block), h_)).cast<float>();
}

PinholeView::Cell PinholeView::Look(const VoxelIndex& first, int side_voxels) const {
  const Eigen::Vector3f corner =
      (T_X_W_ * Eigen::Vector3d(first.cast<double>() * h_)).cast<float>();
  const Eigen::Matrix3f edges = R_X_W_ * (voxel_size_m() * static_cast<float>(side_voxels));
  float u0 = std::numeric_limits<float>::max(), v0 = u0, nearest = u0;
  float u1 = -u0, v1 = -u0, farthest = -u0;
  for (int i = 0; i < 8; ++i) {
    Eigen::Vector3f p = corner;
    if (i & 1) p += edges.col(0);
    if (i & 2) p += edges.col(1);
    if (i & 4) p += edges.col(2);
    nearest = std::min(nearest, p.z());
    farthest = std::max(farthest, p.z());
    const float inverse = 1.f / std::max(p.z(), 1e-3f);
    const float u = image_->fx() * p.x() * inverse + image_->cx();
    const float v = image_->fy() * p.y() * inverse + image_->cy();
    u0 = std::min(u0, u), u1 = std::max(u1, u);
    v0 = std::min(v0, v), v1 = std::max(v1, v);
  }
  if (farthest <= 0.f || nearest >= max_depth_m_) return {Seen::kNothing, nearest};
  // Cells at the camera plane have no footprint; few are there, so look at each of their voxels.
  if (nearest < 0.5f * voxel_size_m()) return {Seen::kPart, nearest};
  const float right = static_cast<float>(image_->width() - 1);
  const float bottom = static_cast<float>(image_->height() - 1);
  if (u1 < -0.5f || v1 < -0.5f || u0 > right + 0.5f || v0 > bottom + 0.5f) {
    return {Seen::kNothing, nearest};
  }
  // All pixels of the footprint, dilated by one.
  const bool whole = u0 >= 1.f && v0 >= 1.f && u1 <= right - 1.f && v1 <= bottom - 1.f;
  const RangePyramid::Bounds bounds =
      pyramid_.Over(static_cast<int>(std::max(u0 - 1.f, 0.f)),
                    static_cast<int>(std::ceil(std::min(u1 + 1.f, right))),
                    static_cast<int>(std::max(v0 - 1.f, 0.f)),
                    static_cast<int>(std::ceil(std::min(v1 + 1.f, bottom))));
  if (bounds.greatest <= nearest) return {Seen::kNothing, nearest};
  const bool free = whole && bounds.least > farthest && farthest <= max_depth_m_;
  return {free ? Seen::kFree : Seen::kPart, nearest};
}

std::vector<BlockIndex> PinholeView::VisibleBlocks() const {
  // The frustum's box: the eye and the four far corners.
  Eigen::AlignedBox3d box(T_W_X_.translation());
  for (const float u : {-0.5f, static_cast<float>(image_->width()) - 0.5f}) {
    for (const float v : {-0.5f, static_cast<float>(image_->height()) - 0.5f}) {
      const Eigen::Vector3d ray((u - image_->cx()) / image_->fx(),
                                (v - image_->cy()) / image_->fy(), 1);
      box.extend(T_W_X_ * Eigen::Vector3d(max_depth_m_ * ray));
    }
  }
  const BlockIndex low = BlockOf(VoxelOf(box.min(), h_)), high = BlockOf(VoxelOf(box.max(), h_));
  const auto super = [](int b) { return b >> 2; };  // / kSuperSide, rounded down
  static_assert(kSuperSide == 4);
  const Eigen::Vector3i first(super(low.x), super(low.y), super(low.z));
  const Eigen::Vector3i count = Eigen::Vector3i(super(high.x), super(high.y), super(high.z)) -
                                first + Eigen::Vector3i::Ones();
  std::vector<uint8_t> visible(static_cast<size_t>(count.x()) * count.y() * count.z());
  size_t i = 0;
  for (int x = 0; x < count.x(); ++x) {
    for (int y = 0; y < count.y(); ++y) {
      for (int z = 0; z < count.z(); ++z, ++i) {
        constexpr int kSide = kSuperSide * kBlockSide;
        visible[i] = Look((first + Eigen::Vector3i(x, y, z)) * kSide, kSide).seen != Seen::kNothing;
      }
    }
  }
  std::vector<BlockIndex> blocks;
  for (int x = low.x; x <= high.x; ++x) {
    for (int y = low.y; y <= high.y; ++y) {
      const uint8_t* row =
          &visible[(static_cast<size_t>(super(x) - first.x()) * count.y() + super(y) - first.y()) *
                   count.z()];
      for (int z = low.z; z <= high.z; ++z) {
        if (row[super(z) - first.z()]) blocks.push_back({x, y, z});
      }
    }
  }
  return blocks;
}

}  // namespace clearance
