#include "tests/testing/band_accuracy.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "absl/container/flat_hash_map.h"

namespace clearance::testing {
namespace {

using Eigen::Vector3d;

double Milliseconds(std::chrono::steady_clock::time_point since) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - since)
      .count();
}

double Median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// Share of points with a crossing within sqrt(3)/2 voxel, the paper's coverage.
double Coverage(const std::vector<Vector3d>& crossings, const std::vector<Vector3d>& points,
                double h) {
  absl::flat_hash_map<BlockIndex, std::vector<Vector3d>> cells;  // of one voxel
  const auto cell = [&](const Vector3d& p) {
    const VoxelIndex v = VoxelOf(p, h);
    return BlockIndex{v.x(), v.y(), v.z()};
  };
  for (const Vector3d& c : crossings) cells[cell(c)].push_back(c);
  size_t covered = 0;
  for (const Vector3d& p : points) {
    const BlockIndex at = cell(p);
    bool found = false;
    for (int k = 0; k < 27 && !found; ++k) {
      const auto it = cells.find({at.x + k / 9 - 1, at.y + k / 3 % 3 - 1, at.z + k % 3 - 1});
      if (it == cells.end()) continue;
      for (const Vector3d& c : it->second) found |= (c - p).norm() < h * std::sqrt(3.0) / 2;
    }
    covered += found;
  }
  return points.empty() ? 0 : static_cast<double>(covered) / points.size();
}

}  // namespace

FusedBand FuseScene(const ViewedScene& viewed, const FusionRun& run) {
  FusedBand out{SurfaceMap(run.voxel_size_m), {}};
  std::vector<double> band_ms, gather_ms;
  for (size_t i = 0; i < std::min(viewed.views.size(), run.max_views); ++i) {
    const Pose& T_W_X = viewed.views[i];
    const DepthImage depth = viewed.scene.RenderDepth(T_W_X, run.intrinsics, run.noise_m, i + 1);
    const RangeImage image = RangeImage::FromDepth(depth, run.max_range_m);
    Eigen::Matrix3Xf points_X(3, depth.depth.size());
    std::vector<uint32_t> indices;
    for (size_t k = 0; k < depth.depth.size(); ++k) {
      const int u = static_cast<int>(k % depth.width), v = static_cast<int>(k / depth.width);
      if (!image.has_surface(u, v)) continue;
      points_X.col(k) = image.Point(u, v);
      indices.push_back(static_cast<uint32_t>(k));
      if (k % 211 == 0) {
        out.observed.push_back(viewed.scene.NearestSurface(T_W_X * points_X.col(k).cast<double>()));
      }
    }
    auto start = std::chrono::steady_clock::now();
    const LocalVoxels voxels = GatherVoxels(points_X, indices, T_W_X, run.voxel_size_m);
    gather_ms.push_back(Milliseconds(start));
    start = std::chrono::steady_clock::now();
    SurfaceUpdate update;
    update.band = ObserveBand(voxels, image, T_W_X, kStaticWorld, out.map, run.band);
    band_ms.push_back(Milliseconds(start));
    out.map.Apply(update, run.fusion);
  }
  out.band_ms = Median(band_ms);
  out.gather_ms = Median(gather_ms);
  return out;
}

std::vector<Vector3d> ZeroCrossings(const SurfaceMap& map, float min_weight) {
  const double h = map.voxel_size_m();
  std::vector<float> mean(kHaloVoxels), weight(kHaloVoxels);
  std::vector<Vector3d> crossings;
  for (const BlockIndex& block : map.BandBlocks()) {
    map.ReadBand(block, mean.data(), weight.data());
    for (int o = 0; o < kBlockVoxels; ++o) {
      const int x = o >> 6, y = (o >> 3) & 7, z = o & 7;
      const int a = HaloOffset(x, y, z);
      if (weight[a] < min_weight) continue;
      for (int axis = 0; axis < 3; ++axis) {
        const int b = HaloOffset(x + (axis == 0), y + (axis == 1), z + (axis == 2));
        if (weight[b] < min_weight || (mean[a] > 0) == (mean[b] > 0)) continue;
        crossings.push_back(VoxelCentre(VoxelAt(block, o), h) +
                            Vector3d::Unit(axis) * (h * mean[a] / (mean[a] - mean[b])));
      }
    }
  }
  return crossings;
}

BandError MeasureBand(const FusedBand& fused, const AnalyticScene& truth,
                      const FusionOptions& fusion) {
  const double h = fused.map.voxel_size_m();
  BandError out;
  size_t wrong = 0;
  for (const BlockIndex& block : fused.map.BandBlocks()) {
    const float* mean = fused.map.MeanBlock(block);
    const float* weight = fused.map.WeightBlock(block);
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (weight[o] < fusion.min_weight) continue;
      const double d = truth.Distance(VoxelCentre(VoxelAt(block, o), h));
      out.band.push_back(std::abs(d - mean[o]));
      if (std::abs(d) > 0.05 * h && (d > 0) != (mean[o] > 0)) ++wrong;
    }
  }
  const std::vector<Vector3d> crossings = ZeroCrossings(fused.map, fusion.min_weight);
  for (const Vector3d& c : crossings) {
    const double d = truth.Distance(c);
    out.crossing.push_back(std::abs(d));
    out.crossing_bias_m += d / crossings.size();
  }
  std::sort(out.band.begin(), out.band.end());
  std::sort(out.crossing.begin(), out.crossing.end());
  out.wrong_sign = out.band.empty() ? 0 : static_cast<double>(wrong) / out.band.size();
  out.covered = Coverage(crossings, fused.observed, h);
  return out;
}

double BandError::Mean(const std::vector<double>& sorted) {
  double sum = 0;
  for (double e : sorted) sum += e;
  return sorted.empty() ? 0 : sum / sorted.size();
}

double BandError::Quantile(const std::vector<double>& sorted, double q) {
  if (sorted.empty()) return 0;
  return sorted[std::min(sorted.size() - 1, static_cast<size_t>(q * sorted.size()))];
}

double BandError::Rms(const std::vector<double>& sorted) {
  double sum = 0;
  for (double e : sorted) sum += e * e;
  return sorted.empty() ? 0 : std::sqrt(sum / sorted.size());
}

}  // namespace clearance::testing
