#include "tests/evaluation/site_candidates.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <string>
#include <vector>

#include "server/esdf/exact_transform.h"
#include "server/esdf/site_extraction.h"
#include "server/map/surface_map.h"
#include "tests/testing/analytic_scene.h"

namespace clearance::evaluation {
namespace {

using testing::Solid;

constexpr double kH = 0.1, kExtent = 2.0;

// Mean of the crossings on the edges to the six face neighbours, where they lie in the own cube.
bool EdgeCrossings(const float* mean, const float* weight, int h, Eigen::Vector3d* offset) {
  constexpr int kStride[3] = {kHaloSide * kHaloSide, kHaloSide, 1};
  *offset = Eigen::Vector3d::Zero();
  int count = 0;
  for (int a = 0; a < 3; ++a) {
    for (int sign : {-1, 1}) {
      const int other = h + sign * kStride[a];
      if (!(weight[other] > 0) || (mean[h] < 0) == (mean[other] < 0)) continue;
      const double t = mean[h] / (mean[h] - mean[other]);
      if (t > 0.5) continue;
      (*offset)[a] += sign * t;
      ++count;
    }
  }
  if (count > 0) *offset /= count;
  return count > 0;
}

std::vector<Eigen::Vector3d> Sites(const SurfaceMap& map, bool by_edges) {
  std::vector<Eigen::Vector3d> sites;
  for (const BlockIndex& b : map.BandBlocks()) {
    float mean[kHaloVoxels], weight[kHaloVoxels];
    map.ReadBand(b, mean, weight);
    BlockSites found;
    if (!by_edges) ExtractSites(mean, weight, kH, 0.3f, &found);
    for (int o = 0; o < kBlockVoxels; ++o) {
      const int h = HaloOffset(o >> 6, (o >> 3) & 7, o & 7);
      Eigen::Vector3d offset;
      if (by_edges) {
        if (!(weight[h] > 0) || !EdgeCrossings(mean, weight, h, &offset)) continue;
      } else {
        if (!Test(found.mask, o)) continue;
        offset = found.site[o].to_site_voxels().cast<double>();
      }
      sites.push_back(VoxelCentre(VoxelAt(b, o), kH) + offset * kH);
    }
  }
  return sites;
}

SurfaceMap Fused(const Solid& solid, double noise_m, std::mt19937& rng) {
  SurfaceMap map(kH);
  SurfaceUpdate update;
  std::normal_distribution<double> noise;
  const int side = static_cast<int>(kExtent / (8 * kH)) + 1;
  for (int i = 0; i < 8 * side * side * side; ++i) {
    const BlockIndex b{i / (4 * side * side) - side, i / (2 * side) % (2 * side) - side,
                       i % (2 * side) - side};
    BandObservations::Block block{b, static_cast<uint32_t>(update.band.offset.size()), 0};
    for (int o = 0; o < kBlockVoxels; ++o) {
      const double d = solid.Distance(VoxelCentre(VoxelAt(b, o), kH));
      if (std::abs(d) > 2 * kH) continue;
      update.band.offset.push_back(static_cast<uint16_t>(o));
      update.band.distance_m.push_back(static_cast<float>(d + noise_m * noise(rng)));
      update.band.weight.push_back(3);
    }
    block.end = static_cast<uint32_t>(update.band.offset.size());
    if (block.end > block.begin) update.band.blocks.push_back(block);
  }
  map.Apply(update, FusionOptions());
  return map;
}

void PrintColumn(std::vector<double> values) {
  if (values.empty()) {
    printf("          none          |");
    return;
  }
  double mean = 0;
  for (double v : values) mean += v;
  std::sort(values.begin(), values.end(),
            [](double a, double b) { return std::abs(a) < std::abs(b); });
  printf(" %+.3f %6.3f %6.3f |", mean / values.size(), std::abs(values[values.size() * 99 / 100]),
         std::abs(values.back()));
}

Solid MakeSolid(const std::string& name, uint32_t seed) {
  Solid s;
  s.T_W_P = testing::RandomPose(seed, 0.3);
  if (name == "plane") {
    s.kind = Solid::Kind::kHalfSpace;
  } else if (name == "grid plane") {  // along a border of cubes
    s.kind = Solid::Kind::kHalfSpace;
    s.T_W_P = Pose::Identity();
  } else if (name == "sphere") {
    s.kind = Solid::Kind::kSphere;
    s.size.setConstant(0.8);
  } else if (name == "box") {
    s.size = {1.5, 1.1, 0.9};
  } else {
    s.kind = Solid::Kind::kCylinder;
    s.size = {name == "8 cm pole" ? 0.04 : 0.15, 0, 10};
  }
  return s;
}

}  // namespace

void PrintSiteCandidates() {
  printf(
      "Errors in voxels (mean, 99th percentile and maximum of the absolute):\n"
      "solid      noise  sites  | site to surface        | surface to site       "
      " | distance to 1 m\n");
  for (double noise_m : {0.0, 0.01, 0.02}) {
    for (const char* name : {"plane", "grid plane", "sphere", "box", "8 cm pole", "30 cm pole"}) {
      for (bool by_edges : {false, true}) {
        std::vector<double> off, gap, distance;
        for (uint32_t seed = 1; seed <= 6; ++seed) {
          std::mt19937 rng(seed);
          std::uniform_real_distribution<double> u(-1, 1);
          const Solid solid = MakeSolid(name, seed);
          const std::vector<Eigen::Vector3d> sites = Sites(Fused(solid, noise_m, rng), by_edges);
          const ExactTransform exact(sites, kH, 20.0);
          // The outermost voxels have no neighbours to tell a gradient by.
          const auto inside = [](const Eigen::Vector3d& p) {
            return p.cwiseAbs().maxCoeff() < kExtent - 2 * kH;
          };
          for (const auto& s : sites) {
            if (inside(s)) off.push_back(std::abs(solid.Distance(s)) / kH);
          }
          for (int i = 0; i < 4000; ++i) {
            const Eigen::Vector3d p = 1.5 * Eigen::Vector3d(u(rng), u(rng), u(rng));
            const double d = solid.Distance(p);
            const Eigen::Vector3d foot = p - d * solid.Gradient(p);
            if (d < 0 || d > 1 || !inside(foot)) continue;
            gap.push_back(exact.Find(foot).distance_m / kH);
            distance.push_back((exact.Find(p).distance_m - d) / kH);
          }
        }
        printf("%-10s %3.0f mm %-6s |", name, noise_m * 1000, by_edges ? "edges" : "feet");
        PrintColumn(off);
        PrintColumn(gap);
        PrintColumn(distance);
        printf("\n");
      }
    }
  }
}

}  // namespace clearance::evaluation
