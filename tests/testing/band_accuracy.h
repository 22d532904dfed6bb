// How well a fused surface band tells an analytic scene.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/integration/surface_band.h"
#include "server/map/surface_map.h"
#include "tests/testing/analytic_scene.h"

namespace clearance::testing {

struct FusionRun {
  double voxel_size_m = 0.1;
  double noise_m = 0;
  double max_range_m = 6.0;
  Intrinsics intrinsics;
  size_t max_views = 1000;
  BandOptions band;
  FusionOptions fusion;

  FusionRun() { band.truncation_m = 2 * voxel_size_m; }
};

// The fused band, and observed true surface points (on the scene's surface, thinned).
struct FusedBand {
  SurfaceMap map;
  std::vector<Eigen::Vector3d> observed;
  double band_ms = 0, gather_ms = 0;  // medians over the views
};
FusedBand FuseScene(const ViewedScene& scene, const FusionRun& run);

struct BandError {
  std::vector<double> crossing;  // |true distance| at zero crossings of voxel edges, m, sorted
  std::vector<double> band;      // |mean - true distance| at voxels, m, sorted
  double crossing_bias_m = 0;    // mean of the signed true distance
  double wrong_sign = 0;         // share of voxels farther than 0.05 voxel from the surface
  double covered = 0;            // share of observed points with a crossing within sqrt(3)/2 voxel

  static double Mean(const std::vector<double>& sorted);
  static double Quantile(const std::vector<double>& sorted, double q);
  static double Rms(const std::vector<double>& sorted);
};
BandError MeasureBand(const FusedBand& fused, const AnalyticScene& truth,
                      const FusionOptions& fusion);

// Crossings of the fused mean along voxel edges, both ends with enough weight.
std::vector<Eigen::Vector3d> ZeroCrossings(const SurfaceMap& map, float min_weight);

}  // namespace clearance::testing
