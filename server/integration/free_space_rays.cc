#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "server/integration/free_space_parts.h"
#include "server/integration/range_pyramid.h"
#include "server/integration/ray_counts.h"
#include "server/integration/spherical_view.h"
#include "server/integration/stored_surface.h"

namespace clearance {
namespace {

constexpr int kRowsAtOnce = 2;  // of the image, a task
// A voxel is passed when the ray leaves it this far before its return, in voxels.
constexpr float kStopVoxels = 0.25f;
// A ray refutes stored surface when its return lies this far beyond the cube, in voxels.
constexpr float kBeyondVoxels = 1.f;
// A ray that comes through the cube and out behind the stored plane only later casts doubt: the
// surface may end within the cube. So far on it has to be behind the plane, in voxels, ...
constexpr float kDoubtAheadVoxels = 1.f;
// ... and so far it has to go on at least.
constexpr float kDoubtBeyondVoxels = 2.f;

// One ray in units of voxels, from the sensor, relative to the block that holds the sensor.
struct Ray {
  Eigen::Vector3f origin, direction;  // direction is a unit vector
  float length;                       // of the measured ray
  float reach;                        // as far as it is evidence
};

// Amanatides and Woo's walk: every voxel the ray passes, in order, with where it enters and leaves;
// before the first voxel of a block, the block. Steps are chosen without branches, which no
// processor could predict.
template <typename Enter, typename Visit>
void Walk(const Ray& ray, const Enter& enter_block, const Visit& visit) {
  int at[3], step[3];
  float next[3], delta[3];
  for (int a = 0; a < 3; ++a) {
    at[a] = static_cast<int>(std::floor(ray.origin[a]));
    const float d = ray.direction[a];
    step[a] = d > 0.f ? 1 : -1;
    delta[a] = std::abs(d) > 1e-9f ? 1.f / std::abs(d) : 1e9f;
    const float room = d > 0.f ? static_cast<float>(at[a] + 1) - ray.origin[a]
                               : ray.origin[a] - static_cast<float>(at[a]);
    next[a] = room * delta[a];
  }
  int x = at[0], y = at[1], z = at[2];
  float next_x = next[0], next_y = next[1], next_z = next[2];
  float enter = 0.f;
  int crossed = ~0;
  while (true) {
    const bool x_before_y = next_x < next_y;
    const bool along_x = x_before_y & (next_x < next_z);
    const bool along_y = !x_before_y & (next_y < next_z);
    const bool along_z = !(along_x | along_y);
    const float leave = along_x ? next_x : (along_y ? next_y : next_z);
    if (leave > ray.reach) return;
    if (crossed & ~7) enter_block(BlockIndex{x >> 3, y >> 3, z >> 3});
    visit(((x & 7) << 6) | ((y & 7) << 3) | (z & 7), VoxelIndex(x, y, z), enter, leave);
    enter = leave;
    const int new_x = x + (along_x ? step[0] : 0);
    const int new_y = y + (along_y ? step[1] : 0);
    const int new_z = z + (along_z ? step[2] : 0);
    crossed = (x ^ new_x) | (y ^ new_y) | (z ^ new_z);
    x = new_x, y = new_y, z = new_z;
    next_x += along_x ? delta[0] : 0.f;
    next_y += along_y ? delta[1] : 0.f;
    next_z += along_z ? delta[2] : 0.f;
  }
}

class RaySpace {
 public:
  RaySpace(const RangeImage& image, const Pose& T_W_X, const SurfaceMap& map,
           const FreeSpaceOptions& options)
      : image_(image),
        map_(map),
        inverse_h_(static_cast<float>(1.0 / options.voxel_size_m)),
        max_range_m_(static_cast<float>(options.max_range_m)),
        base_(BlockOf(VoxelOf(T_W_X.translation(), options.voxel_size_m))),
        R_W_X_(T_W_X.linear().cast<float>()),
        eye_(((T_W_X.translation() - BlockOrigin(base_, options.voxel_size_m)) /
              options.voxel_size_m)
                 .cast<float>()) {}

  const BlockIndex& base() const { return base_; }

  void WalkRows(int first, int last, RayCounts& counts) const {
    for (int v = first; v < last; ++v) {
      for (int u = 0; u < image_.width(); ++u) {
        if (image_.measure(u, v) > 0.f) WalkRay(u, v, counts);
      }
    }
  }

 private:
  void WalkRay(int u, int v, RayCounts& counts) const {
    const float range_m = image_.measure(u, v);
    Ray ray;
    ray.origin = eye_;
    ray.direction = R_W_X_ * (image_.Point(u, v) / range_m);
    ray.length = range_m * inverse_h_;
    ray.reach = std::min(ray.length - kStopVoxels, max_range_m_ * inverse_h_);
    RayCounts::Block* in = nullptr;
    const auto enter_block = [&](const BlockIndex& block) { in = &counts.At(block); };
    Walk(ray, enter_block, [&](int offset, const VoxelIndex& at, float enter, float leave) {
      RayCounts::Block& block = *in;
      block.Pass(offset);
      if (Test(block.held, offset) && ray.length >= leave + kBeyondVoxels) {
        Contradict(block, offset, at, ray, enter, leave);
      }
    });
  }

  // Refuted: the ray is, within the cube, clearly behind the plane stored there.
  void Contradict(RayCounts::Block& block, int offset, const VoxelIndex& at, const Ray& ray,
                  float enter, float leave) const {
    const Eigen::Vector3f normal = block.stored.Normal(offset);
    if (normal.isZero()) return block.Doubt(offset);  // which side is which is unknown
    const Eigen::Vector3f from_centre =
        ray.origin - at.cast<float>() - Eigen::Vector3f::Constant(0.5f);
    const float at_origin = block.stored.mean(offset) * inverse_h_ + normal.dot(from_centre);
    const float slope = normal.dot(ray.direction);
    if (at_origin + std::min(enter * slope, leave * slope) < -kPenetrationVoxels) {
      block.Refute(offset);
    } else if (ray.length >= leave + kDoubtBeyondVoxels &&
               at_origin + (leave + kDoubtAheadVoxels) * slope < -kPenetrationVoxels) {
      block.Doubt(offset);
    }
  }

  const RangeImage& image_;
  const SurfaceMap& map_;
  float inverse_h_, max_range_m_;
  BlockIndex base_;
  Eigen::Matrix3f R_W_X_;
  Eigen::Vector3f eye_;  // voxels from the base block's origin
};

}  // namespace

std::vector<FreeBlock> ObserveFreeSpaceRays(const RangeImage& image, const Pose& T_W_X,
                                            const StaticReturns& returns,
                                            const SurfaceMap& static_map,
                                            const FreeSpaceOptions& options) {
  const RaySpace space(image, T_W_X, static_map, options);
  const SphericalView view(image, T_W_X, options.voxel_size_m, options.max_range_m);
  tbb::enumerable_thread_specific<RayCounts> of_threads(
      [&] { return RayCounts(static_map, space.base()); });
  const float inverse_h = static_cast<float>(1.0 / options.voxel_size_m);
  const int tasks = (image.height() + kRowsAtOnce - 1) / kRowsAtOnce;
  tbb::parallel_for(0, tasks, [&](int task) {
    space.WalkRows(task * kRowsAtOnce, std::min(image.height(), (task + 1) * kRowsAtOnce),
                   of_threads.local());
  });

  // Sums and unions of the threads' counts: the same whatever thread walked which ray.
  std::vector<const RayCounts*> counts;
  for (const RayCounts& c : of_threads) counts.push_back(&c);
  const std::vector<BlockIndex> blocks = RayCounts::Blocks(counts);
  std::vector<FreeBlock> out(blocks.size());
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t i) {
    RayCounts::Block sum = RayCounts::Sum(counts, blocks[i]);
    FreeBlock& free = out[i];
    free.block = blocks[i];
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (sum.passed[o] == 0) continue;
      Set(free.probable, o);
      if (!Test(sum.held, o)) continue;
      // Edges and poles are passed beside, too: not while the surface itself returns rays.
      const VoxelIndex own = VoxelAt(blocks[i], o);
      const Eigen::Vector3f normal = sum.stored.Normal(o);
      const float mean = sum.stored.mean(o) * inverse_h;
      const VoxelIndex site = own + SurfaceStep(mean, normal);
      // Rays that graze the cube leave its surface alone, but not what lies behind it.
      int rays = sum.refuted[o];
      if (!normal.isZero()) {
        rays += RayCounts::Passed(counts, own + SurfaceStep(mean + kInsideVoxels, normal));
      }
      const int doubts = sum.doubted[o];
      if (rays + doubts == 0 || returns.Has(own) || returns.Has(site)) continue;
      Set(free.contradicted, o);
      if (IsRefuted(static_map, own, site, rays, doubts)) Set(free.refuted, o);
    }
    view.ObserveConfident(free);
    if (sum.stored.empty()) return;
    for (size_t w = 0; w < free.confident.size(); ++w) {
      const uint64_t empty = free.confident[w] & sum.held[w];
      free.contradicted[w] |= empty;
      free.refuted[w] |= empty;
    }
  });
  std::erase_if(out, [](const FreeBlock& f) { return f.probable == BlockMask{}; });
  return out;
}

}  // namespace clearance
