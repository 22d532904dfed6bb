#include "server/integration/standing.h"

#include <algorithm>
#include <cmath>

#include "server/integration/stored_surface.h"

namespace clearance {
namespace {

constexpr size_t kSamples = 400;
constexpr int kLeastReturns = 20;
constexpr double kLeastShare = 0.6;  // of the rays that could have met the surface

struct Samples {
  std::vector<Eigen::Vector3d> points_L, normals_L;
};

// Points on the submap's surface, spread evenly over its voxels.
Samples SamplesOf(const SurfaceMap& surface) {
  const double h = surface.voxel_size_m();
  std::vector<VoxelIndex> voxels;
  for (const BlockIndex& block : surface.BandBlocks()) {
    const float* mean = surface.MeanBlock(block);
    const float* weight = surface.WeightBlock(block);
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (weight[o] > 0.5f && std::abs(mean[o]) < 0.5 * h) voxels.push_back(VoxelAt(block, o));
    }
  }
  Samples samples;
  const size_t step = std::max<size_t>(1, voxels.size() / kSamples);
  for (size_t i = 0; i < voxels.size(); i += step) {
    StoredSurface stored(surface, BlockOf(voxels[i]));
    const int o = OffsetOf(voxels[i]);
    const Eigen::Vector3d normal = stored.Normal(o).cast<double>();
    if (normal.isZero()) continue;
    samples.points_L.push_back(VoxelCentre(voxels[i], h) - stored.mean(o) * normal);
    samples.normals_L.push_back(normal);
  }
  return samples;
}

struct Fit {
  int returns = 0, beyond = 0;  // static rays that end on the surface, and behind it
  double share() const { return returns > 0 ? double(returns) / (returns + beyond) : 0; }
};

Fit FitAt(const Samples& samples, const RangeImage& image, const Pose& T_X_L, double h) {
  Fit fit;
  for (size_t i = 0; i < samples.points_L.size(); ++i) {
    const Eigen::Vector3d p_X = T_X_L * samples.points_L[i];
    if ((T_X_L.linear() * samples.normals_L[i]).dot(p_X) > -0.2 * p_X.norm()) continue;
    const auto at = image.Project(p_X.cast<float>());
    if (!at) continue;
    const int u = static_cast<int>(std::lround(at->u)), v = static_cast<int>(std::lround(at->v));
    const float measure = image.measure(u, v);
    if (!(measure > 0.f) || image.label(u, v) != 0) continue;
    const double behind = measure - at->measure;
    if (std::abs(behind) <= 0.5 * h) {
      ++fit.returns;
    } else if (behind > 0) {
      ++fit.beyond;
    }
  }
  return fit;
}

}  // namespace

void LetStanding(const RangeImage& image, const Pose& T_W_X, const WorldMap& map,
                 std::vector<ObjectTask>& tasks) {
  const double h = map.config().voxel_size_m;
  for (ObjectTask& task : tasks) {
    const auto known = map.objects().find(task.update.id);
    if (task.update.event != ObjectEvent::kCoasted || !task.points.empty() ||
        known == map.objects().end()) {
      continue;
    }
    const ObjectSubmap& object = known->second;
    const Samples samples = SamplesOf(object.surface());
    const Pose T_X_W = T_W_X.inverse();
    const Fit stays = FitAt(samples, image, T_X_W * object.T_W_L(), h);
    if (stays.returns < kLeastReturns || stays.share() < kLeastShare) continue;
    if (FitAt(samples, image, T_X_W * task.update.T_W_L, h).share() > stays.share()) continue;
    task.update.T_W_L = object.T_W_L();
    task.update.H_W = Pose::Identity();
    task.update.motion_period_s = 1.0;
  }
}

}  // namespace clearance
