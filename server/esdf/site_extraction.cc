#include "server/esdf/site_extraction.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

constexpr int kHaloStride[3] = {kHaloSide * kHaloSide, kHaloSide, 1};

// A mean whose slope is far from one is no longer a distance here (edges, thin parts): there the
// value alone is trusted, and no second value is looked up.
constexpr float kMinSlope = 0.9f, kMaxSlope = 1.3f;
constexpr float kMaxCorrectionVoxels = 0.25f;
// Feet farther than this are not in the own cube, before or after the correction.
constexpr float kReachVoxels = 0.87f + kMaxCorrectionVoxels;
// A foot this little outside is pulled in: no gap where two neighbours disagree by a hair.
constexpr float kMarginVoxels = 0.03f;
// Below this slope the direction to the surface is unknown.
constexpr float kFlatSlope = 0.05f;

// Site uncertainty, in voxels: one observation of weight 1 is good for 0.3, averaging improves it,
// and the grid itself limits it.
constexpr float kObservationSigma = 0.3f, kGridSigma = 0.05f;

float SigmaVoxels(float weight) {
  return std::sqrt(kGridSigma * kGridSigma + kObservationSigma * kObservationSigma / weight);
}

// Trilinear interpolation at `offset` voxels (each within +-1) from the centre of voxel h. False
// where one of the eight voxels is unusable or belongs to another surface.
bool InterpolateMean(const float* mean, const float* weight, int h, const Eigen::Vector3f& offset,
                     float voxel_size_m, float min_weight, float* value) {
  if (!(offset.cwiseAbs().maxCoeff() <= 1.f)) return false;
  int step[3];
  float t[3];
  for (int a = 0; a < 3; ++a) {
    step[a] = offset[a] < 0 ? -kHaloStride[a] : kHaloStride[a];
    t[a] = std::abs(offset[a]);
  }
  float sum = 0, low = mean[h], high = mean[h];
  for (int corner = 0; corner < 8; ++corner) {
    int i = h;
    float share = 1;
    for (int a = 0; a < 3; ++a) {
      if (corner >> a & 1) {
        i += step[a];
        share *= t[a];
      } else {
        share *= 1 - t[a];
      }
    }
    if (!(weight[i] >= min_weight)) return false;
    low = std::min(low, mean[i]);
    high = std::max(high, mean[i]);
    sum += share * mean[i];
  }
  if (high - low > kMaxJumpVoxels * std::sqrt(3.f) * voxel_size_m) return false;
  *value = sum;
  return true;
}

int16_t Quantised(float voxels) {
  return static_cast<int16_t>(std::lround(voxels * (1.f / FieldVoxel::kUnit)));
}

// The foot of the voxel at h on the surface. False where it lies in another voxel's cube.
bool SiteOf(const float* mean, const float* weight, int h, float voxel_size_m, float min_weight,
            FieldVoxel* site) {
  const float m = mean[h] / voxel_size_m;  // voxels from here on
  if (!(std::abs(m) < kReachVoxels)) return false;
  const Eigen::Vector3f gradient = MeanGradient(mean, weight, h, voxel_size_m, min_weight);
  const float slope = gradient.norm();
  Eigen::Vector3f n = Eigen::Vector3f::UnitZ();
  Eigen::Vector3f foot = Eigen::Vector3f::Zero();
  if (slope > kFlatSlope) {
    n = gradient / slope;
    foot = -m * n;
    float value;
    // A second look at the mean, where the surface is thought to be, averages noise; and where the
    // surface runs along a border of cubes, both sides come to the same verdict whose it is.
    if (slope > kMinSlope && slope < kMaxSlope &&
        InterpolateMean(mean, weight, h, foot, voxel_size_m, min_weight, &value)) {
      foot -= std::clamp(value / voxel_size_m, -kMaxCorrectionVoxels, kMaxCorrectionVoxels) * n;
    }
  } else if (std::abs(m) > 0.25f) {
    return false;  // near a surface, but where is it?
  }
  int16_t d[3];
  for (int a = 0; a < 3; ++a) {
    if (!(std::abs(foot[a]) <= 0.5f + kMarginVoxels)) return false;
    d[a] = std::clamp<int16_t>(Quantised(foot[a]), -128, 127);
  }
  const float sigma = slope > kFlatSlope ? SigmaVoxels(weight[h]) : 0.5f;
  const int attributes = CodeOfSigmaVoxels(sigma) << 4 | CodeOfNormal(n) << 9;
  *site = {d[0], d[1], d[2], static_cast<uint16_t>(attributes)};
  return true;
}

}  // namespace

Eigen::Vector3f MeanGradient(const float* mean, const float* weight, int h, float voxel_size_m,
                             float min_weight) {
  const float limit = kMaxJumpVoxels * voxel_size_m;
  Eigen::Vector3f gradient;
  for (int a = 0; a < 3; ++a) {
    const int below = h - kHaloStride[a], above = h + kHaloStride[a];
    const float down = mean[h] - mean[below], up = mean[above] - mean[h];
    const bool has_down = weight[below] >= min_weight && std::abs(down) <= limit;
    const bool has_up = weight[above] >= min_weight && std::abs(up) <= limit;
    float difference = 0;
    if (has_down && has_up) {
      difference = 0.5f * (down + up);
    } else if (has_down) {
      difference = down;
    } else if (has_up) {
      difference = up;
    }
    gradient[a] = difference / voxel_size_m;
  }
  return gradient;
}

void ExtractSites(const float mean[kHaloVoxels], const float weight[kHaloVoxels],
                  float voxel_size_m, float min_weight, BlockSites* sites) {
  sites->mask = {};
  for (int o = 0; o < kBlockVoxels; ++o) {
    const int h = HaloOffset(o >> 6, (o >> 3) & 7, o & 7);
    if (!(weight[h] >= min_weight)) continue;
    if (SiteOf(mean, weight, h, voxel_size_m, min_weight, &sites->site[o])) Set(sites->mask, o);
  }
}

std::vector<SurfaceSite> ExtractSurfaceSites(const SurfaceMap& map, const FusionOptions& options) {
  const std::vector<BlockIndex> blocks = map.BandBlocks();
  const float h = static_cast<float>(map.voxel_size_m());
  std::vector<std::vector<SurfaceSite>> found(blocks.size());
  tbb::parallel_for(size_t{0}, blocks.size(), [&](size_t i) {
    float mean[kHaloVoxels], weight[kHaloVoxels];
    BlockSites sites;
    map.ReadBand(blocks[i], mean, weight);
    ExtractSites(mean, weight, h, options.min_weight, &sites);
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (!Test(sites.mask, o)) continue;
      const FieldVoxel& s = sites.site[o];
      const Eigen::Vector3d centre = VoxelCentre(VoxelAt(blocks[i], o), map.voxel_size_m());
      found[i].push_back({centre.cast<float>() + s.to_site_voxels() * h,
                          NormalOfCode(s.normal_code()), SigmaVoxelsOfCode(s.sigma_code()) * h});
    }
  });
  std::vector<SurfaceSite> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

}  // namespace clearance
