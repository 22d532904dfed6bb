#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/field/lanes.h"
#include "server/integration/free_space_parts.h"
#include "server/integration/pinhole_view.h"
#include "server/integration/stored_surface.h"

namespace clearance {
namespace {

constexpr size_t kChunk = 128;  // blocks a task
// Free at the centre pixel: the return lies this far beyond the cube's centre, in voxels.
constexpr float kProbableMarginVoxels = 0.5f;
// A ray refutes stored surface when its return lies this far beyond a point behind that surface.
constexpr float kBeyondVoxels = 0.5f;
// The same where the stored surface has no direction.
constexpr float kBeyondUnknownVoxels = 2.f;
// A point so far outside the image still counts, in voxels.
constexpr float kAsideVoxels = 0.4f;

// Voxel by voxel: the centre pixel for probable, all pixels around for confident.
class VoxelTests {
 public:
  explicit VoxelTests(const PinholeView& view)
      : view_(view),
        width_(view.image().width()),
        height_(view.image().height()),
        measure_(view.image().measures().data()),
        steps_X_(view.R_X_W() * view.voxel_size_m()) {}

  void Observe(const PinholeView::Cell& cell, FreeBlock& out) const {
    const Eigen::Vector3f first_X = view_.FirstCentre(out.block);
    const int level = FootprintLevel(cell.nearest, first_X);
    const float* dilated = level > 0 ? view_.pyramid().dilated_least(level) : nullptr;
    const int stride = level > 0 ? view_.pyramid().dilated_width(level) : 0;
    // Octants first: most of a block's voxels are decided with them.
    using Seen = PinholeView::Seen;
    Seen octants[8];
    for (int i = 0; i < 8; ++i) {
      octants[i] = view_
                       .Look(FirstVoxel(out.block) + 4 * VoxelIndex(i >> 2, (i >> 1) & 1, i & 1),
                             kBlockSide / 2)
                       .seen;
    }
    for (int x = 0; x < kBlockSide; ++x) {
      uint64_t confident = 0, probable = 0;
      for (int y = 0; y < kBlockSide; ++y) {
        const Seen* half = &octants[(x & 4) | ((y & 4) >> 1)];  // along z
        const uint64_t whole =
            (half[0] == Seen::kFree ? 0x0f : 0) | (half[1] == Seen::kFree ? 0xf0 : 0);
        confident |= whole << (8 * y);
        probable |= whole << (8 * y);
        if (half[0] != Seen::kPart && half[1] != Seen::kPart) continue;
        const Eigen::Vector3f row_X = first_X + static_cast<float>(x) * steps_X_.col(0) +
                                      static_cast<float>(y) * steps_X_.col(1);
        Row(row_X, dilated, stride, level, y * 8, confident, probable);
      }
      out.confident[x] = confident;
      out.probable[x] = probable;
    }
  }

 private:
  // The level whose 3 x 3 cells cover any voxel's footprint and one pixel more; 0 where none does.
  int FootprintLevel(float nearest, const Eigen::Vector3f& first_X) const {
    const float h = view_.voxel_size_m();
    if (nearest < 0.5f * h) return 0;
    const Eigen::Vector3f middle = first_X + 3.5f * steps_X_.rowwise().sum();
    const float reach = 0.87f * kBlockSide * h;
    const Eigen::Vector3f& half = view_.half_extent_X();
    // A voxel's extent along the axis moves its pixels by its slope.
    const float slope_u = std::min((std::abs(middle.x()) + reach) / nearest, view_.max_slope_u());
    const float slope_v = std::min((std::abs(middle.y()) + reach) / nearest, view_.max_slope_v());
    const float pixels_u = view_.image().fx() * (half.x() + slope_u * half.z()) / nearest;
    const float pixels_v = view_.image().fy() * (half.y() + slope_v * half.z()) / nearest;
    const float radius = std::max(pixels_u, pixels_v) + 1.f;
    int level = 1;
    while (static_cast<float>(1 << level) < radius) ++level;
    return level < view_.pyramid().levels() ? level : 0;
  }

  // Eight voxels along z of W at once.
  void Row(const Eigen::Vector3f& row_X, const float* dilated, int stride, int level, int shift,
           uint64_t& confident, uint64_t& probable) const {
    constexpr Lanes kSteps = {0, 1, 2, 3, 4, 5, 6, 7};
    const RangeImage& image = view_.image();
    const float ahead = kProbableMarginVoxels * view_.voxel_size_m();
    const float extent = view_.half_extent_X().z();
    const float right = static_cast<float>(width_), bottom = static_cast<float>(height_);
    const Lanes z = row_X.z() + kSteps * steps_X_(2, 2);
    const Lanes inverse = 1.f / Max(z, Splat(1e-3f));
    // Shifted by half a pixel, so that cutting off the fraction rounds.
    const Lanes u =
        image.fx() * (row_X.x() + kSteps * steps_X_(0, 2)) * inverse + image.cx() + 0.5f;
    const Lanes v =
        image.fy() * (row_X.y() + kSteps * steps_X_(1, 2)) * inverse + image.cy() + 0.5f;
    const LanesInt inside = (u >= 0.f) & (v >= 0.f) & (u < right) & (v < bottom) & (z > extent) &
                            (z <= view_.max_depth_m());
    if (Bits(inside) == 0) return;
    const LanesInt column = __builtin_convertvector(Select(inside, u, Lanes{}), LanesInt);
    const LanesInt row = __builtin_convertvector(Select(inside, v, Lanes{}), LanesInt);
    const Lanes measure = Gather(measure_, row * width_ + column);
    const uint64_t free = Bits(inside & (measure >= z + ahead));
    if (free == 0) return;
    probable |= free << shift;
    if (!dilated) return;
    const Lanes least = Gather(dilated, (row >> level) * stride + (column >> level));
    const uint64_t sure =
        Bits(inside & (least >= z + extent) & (z + extent <= view_.max_depth_m()));
    confident |= sure << shift;
  }

  const PinholeView& view_;
  int width_, height_;
  const float* measure_;
  Eigen::Matrix3f steps_X_;
};

// Surface that was stored and is not there any more.
class Contradictions {
 public:
  Contradictions(const PinholeView& view, const StaticReturns& returns, const SurfaceMap& map)
      : view_(view), returns_(returns), map_(map) {}

  void Observe(FreeBlock& out) const {
    StoredSurface stored(map_, out.block);
    if (stored.empty()) return;
    const BlockMask held = stored.HeldVoxels();
    const Eigen::Vector3f first_X = view_.FirstCentre(out.block);
    for (int x = 0; x < kBlockSide; ++x) {
      out.contradicted[x] = out.refuted[x] = held[x] & out.confident[x];
      for (uint64_t bits = held[x] & ~out.confident[x]; bits; bits &= bits - 1) {
        LookThrough(stored, x * 64 + __builtin_ctzll(bits), first_X, out);
      }
    }
  }

 private:
  void LookThrough(StoredSurface& stored, int offset, const Eigen::Vector3f& first_X,
                   FreeBlock& out) const {
    const float h = view_.voxel_size_m();
    const Eigen::Vector3f centre_X =
        first_X + view_.R_X_W() * (h * VoxelAt({}, offset).cast<float>());
    if (centre_X.z() <= h) return;
    // A point that would be half a voxel inside, if the stored surface were still there.
    const float in = std::max(0.f, stored.mean(offset) + kPenetrationVoxels * h);
    const Eigen::Vector3f normal_W = in > 0.f ? stored.Normal(offset) : Eigen::Vector3f::Zero();
    // Where the stored surface has no direction, the centre stands for it, with more room behind.
    const float beyond = in > 0.f && normal_W.isZero() ? kBeyondUnknownVoxels : kBeyondVoxels;
    const Eigen::Vector3f behind_X = centre_X - view_.R_X_W() * (in * normal_W);
    int rays = RaysBeyond(behind_X, beyond * h);
    if (rays == 0 && !normal_W.isZero()) {
      const float further = (kInsideVoxels - kPenetrationVoxels) * h;
      rays = RaysBeyond(behind_X - view_.R_X_W() * (further * normal_W), beyond * h);
    }
    if (rays == 0) return;
    // Edges and poles are seen beside, too: not while the surface itself returns rays.
    const VoxelIndex own = VoxelAt(out.block, offset);
    const VoxelIndex site = own + SurfaceStep(stored.mean(offset) / h, normal_W);
    if (returns_.Has(own) || returns_.Has(site)) return;
    const bool has_normal = in == 0.f || !normal_W.isZero();
    Set(out.contradicted, offset);
    if (IsRefuted(map_, own, site, has_normal ? rays : 0, has_normal ? 0 : rays)) {
      Set(out.refuted, offset);
    }
  }

  // The pixel at a coordinate, or the one at the image's border where that is no farther than
  // `aside`: what is half out of sight is seen there. -1 elsewhere.
  static int Inside(float at, float aside, int size) {
    const float last = static_cast<float>(size - 1);
    if (!(at > -0.5f - aside && at < last + 0.5f + aside)) return -1;
    return static_cast<int>(std::lround(std::clamp(at, 0.f, last)));
  }

  // Of the pixel that sees a point and its four neighbours, how many return from `room` beyond it;
  // 0 where the pixel itself does not.
  int RaysBeyond(const Eigen::Vector3f& p_X, float room) const {
    const RangeImage& image = view_.image();
    if (!(p_X.z() > 0)) return 0;
    const float fx = image.fx() / p_X.z(), fy = image.fy() / p_X.z();
    const int u =
        Inside(p_X.x() * fx + image.cx(), kAsideVoxels * view_.voxel_size_m() * fx, image.width());
    const int v =
        Inside(p_X.y() * fy + image.cy(), kAsideVoxels * view_.voxel_size_m() * fy, image.height());
    if (u < 0 || v < 0) return 0;
    const float beyond = p_X.z() + room;
    if (image.measure(u, v) < beyond) return 0;
    int rays = 1;
    if (u > 0) rays += image.measure(u - 1, v) >= beyond;
    if (v > 0) rays += image.measure(u, v - 1) >= beyond;
    if (u + 1 < image.width()) rays += image.measure(u + 1, v) >= beyond;
    if (v + 1 < image.height()) rays += image.measure(u, v + 1) >= beyond;
    return rays;
  }

  const PinholeView& view_;
  const StaticReturns& returns_;
  const SurfaceMap& map_;
};

}  // namespace

std::vector<FreeBlock> ObserveFreeSpacePinhole(const RangeImage& image, const Pose& T_W_X,
                                               const StaticReturns& returns,
                                               const SurfaceMap& static_map,
                                               const FreeSpaceOptions& options) {
  const PinholeView view(image, T_W_X, options.voxel_size_m, options.max_range_m);
  const std::vector<BlockIndex> blocks = view.VisibleBlocks();
  const VoxelTests voxels(view);
  const Contradictions contradictions(view, returns, static_map);
  std::vector<std::vector<FreeBlock>> parts((blocks.size() + kChunk - 1) / kChunk);
  tbb::parallel_for(size_t{0}, parts.size(), [&](size_t part) {
    const size_t end = std::min(blocks.size(), (part + 1) * kChunk);
    for (size_t i = part * kChunk; i < end; ++i) {
      const PinholeView::Cell cell = view.Look(FirstVoxel(blocks[i]), kBlockSide);
      if (cell.seen == PinholeView::Seen::kNothing) continue;
      FreeBlock out;
      out.block = blocks[i];
      if (cell.seen == PinholeView::Seen::kFree) {
        out.confident = out.probable = kFullMask;
      } else {
        voxels.Observe(cell, out);
      }
      contradictions.Observe(out);
      if (out.probable != BlockMask{} || out.contradicted != BlockMask{}) {
        parts[part].push_back(out);
      }
    }
  });
  std::vector<FreeBlock> all;
  for (const auto& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

}  // namespace clearance
