#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

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
    for (int x = 0; x < kBlockSide; ++x) {
      uint64_t confident = 0, probable = 0;
      for (int y = 0; y < kBlockSide; ++y) {
        const Eigen::Vector3f row_X = first_X + static_cast<float>(x) * steps_X_.col(0) +
                                      static_cast<float>(y) * steps_X_.col(1);
        Row(row_X, dilated, stride, level, y * 8, confident, probable);
      }
      out.confident[x] = confident & probable;
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

  // Eight voxels along z of W, without branches: the compiler makes vectors of this loop.
  void Row(const Eigen::Vector3f& row_X, const float* dilated, int stride, int level, int shift,
           uint64_t& confident, uint64_t& probable) const {
    const RangeImage& image = view_.image();
    const float fx = image.fx(), fy = image.fy(), cx = image.cx() + 0.5f, cy = image.cy() + 0.5f;
    const float dx = steps_X_(0, 2), dy = steps_X_(1, 2), dz = steps_X_(2, 2);
    const float ahead = kProbableMarginVoxels * view_.voxel_size_m();
    const float extent = view_.half_extent_X().z();
    const float most = view_.max_depth_m();
    int pixel[8], inside[8], cell[8];
    float depth[8];
    for (int k = 0; k < 8; ++k) {
      const float t = static_cast<float>(k);
      const float z = row_X.z() + t * dz;
      const float inverse = 1.f / std::max(z, 1e-3f);
      const float u = fx * (row_X.x() + t * dx) * inverse + cx;
      const float v = fy * (row_X.y() + t * dy) * inverse + cy;
      const int iu = static_cast<int>(std::clamp(u, -1.f, static_cast<float>(width_)));
      const int iv = static_cast<int>(std::clamp(v, -1.f, static_cast<float>(height_)));
      inside[k] = (u >= 0.f) & (v >= 0.f) & (iu < width_) & (iv < height_) & (z > extent);
      pixel[k] = inside[k] ? iv * width_ + iu : 0;
      cell[k] = inside[k] ? (iv >> level) * stride + (iu >> level) : 0;
      depth[k] = z;
    }
    uint64_t free = 0, sure = 0;
    for (int k = 0; k < 8; ++k) {
      free |= static_cast<uint64_t>(inside[k] & (depth[k] <= most) &
                                    (measure_[pixel[k]] >= depth[k] + ahead))
              << k;
    }
    if (dilated && free) {
      for (int k = 0; k < 8; ++k) {
        sure |= static_cast<uint64_t>(inside[k] & (depth[k] + extent <= most) &
                                      (dilated[cell[k]] >= depth[k] + extent))
                << k;
      }
    }
    confident |= sure << shift;
    probable |= free << shift;
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
      out.contradicted[x] = held[x] & out.confident[x];
      for (uint64_t bits = held[x] & ~out.confident[x]; bits; bits &= bits - 1) {
        const int offset = x * 64 + __builtin_ctzll(bits);
        if (LooksThrough(stored, out.block, offset, first_X)) Set(out.contradicted, offset);
      }
    }
  }

 private:
  bool LooksThrough(StoredSurface& stored, const BlockIndex& block, int offset,
                    const Eigen::Vector3f& first_X) const {
    const float h = view_.voxel_size_m();
    const Eigen::Vector3f centre_X =
        first_X + view_.R_X_W() * (h * VoxelAt({}, offset).cast<float>());
    if (centre_X.z() <= h) return false;
    // A point that would be half a voxel inside, if the stored surface were still there.
    const float in = std::max(0.f, stored.mean(offset) + kPenetrationVoxels * h);
    Eigen::Vector3f normal_W = Eigen::Vector3f::Zero();
    if (in > 0.f) {
      normal_W = stored.Normal(offset);
      if (normal_W.isZero()) return false;
    }
    const Eigen::Vector3f behind_X = centre_X - view_.R_X_W() * (in * normal_W);
    const auto seen = view_.image().Project(behind_X);
    if (!seen) return false;
    const float measure = view_.image().measure(static_cast<int>(std::lround(seen->u)),
                                                static_cast<int>(std::lround(seen->v)));
    if (measure < behind_X.z() + kBeyondVoxels * h) return false;
    // Edges and poles are seen beside, too: not while the surface itself returns rays.
    const VoxelIndex own = VoxelAt(block, offset);
    return !returns_.Has(own) &&
           !returns_.Has(own + SurfaceStep(stored.mean(offset) / h, normal_W));
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
