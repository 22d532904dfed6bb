// Fuses rendered analytic scenes and prints how well the surface band tells them:
//   surface_band_accuracy [--noise M] [--voxel M] [--scene NAME] [--seeds N] [--views N] [--large]
//                         [--kernel se|matern|rq] [--length VOXELS] [--gp-noise V] [--max-variance
//                         V]
// Errors in voxels. Each scene is put at `seeds` random places, turned at random.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <string>

#include "tests/testing/band_accuracy.h"

namespace clearance::testing {
namespace {

void Print(const std::string& name, const BandError& e, double h, double gather_ms,
           double band_ms) {
  std::printf(
      "%-8s %7zu  %6.4f %6.4f %6.4f %6.4f  %+7.4f  %6.4f %6.4f  %6.3f  %6.2f  %6.2f %6.2f\n",
      name.c_str(), e.crossing.size(), BandError::Mean(e.crossing) / h,
      BandError::Rms(e.crossing) / h, BandError::Quantile(e.crossing, 0.95) / h,
      BandError::Quantile(e.crossing, 0.99) / h, e.crossing_bias_m / h, BandError::Mean(e.band) / h,
      BandError::Quantile(e.band, 0.95) / h, 100 * e.wrong_sign, 100 * e.covered, gather_ms,
      band_ms);
}

int Run(int argc, char** argv) {
  CLI::App app{"Accuracy of the fused surface band on analytic scenes"};
  FusionRun run;
  std::string only, kernel = "se";
  int seeds = 3;
  bool large = false;
  app.add_option("--noise", run.noise_m, "depth noise, m");
  app.add_option("--voxel", run.voxel_size_m, "voxel size, m");
  app.add_option("--scene", only, "plane, box, sphere, corner or pole");
  app.add_option("--seeds", seeds, "random placements a scene");
  app.add_option("--views", run.max_views, "views a scene");
  app.add_option("--kernel", kernel, "se, matern or rq");
  app.add_option("--length", run.band.gp.length_scale_voxels, "length scale, voxels");
  app.add_option("--gp-noise", run.band.gp.noise_variance, "noise variance");
  app.add_option("--max-variance", run.band.gp.max_latent_variance, "largest latent variance");
  app.add_option("--min-weight", run.fusion.min_weight, "weight from which a voxel is read");
  app.add_flag("--large", large, "1280 x 720 instead of 320 x 180");
  CLI11_PARSE(app, argc, argv);
  run.band.truncation_m = 2 * run.voxel_size_m;
  if (large) run.intrinsics = Intrinsics::Large();
  const std::map<std::string, KernelType> kernels = {{"se", KernelType::kSquaredExponential},
                                                     {"matern", KernelType::kMatern32},
                                                     {"rq", KernelType::kRationalQuadratic}};
  if (!kernels.contains(kernel)) {
    std::fprintf(stderr, "--kernel is '%s'; it must be se, matern or rq\n", kernel.c_str());
    return 2;
  }
  run.band.gp.kernel = kernels.at(kernel);
  std::printf("%-8s %7s  %27s  %7s  %13s  %6s  %6s  %6s %6s\n", "scene", "n",
              "crossing: mean rms p95 p99", "bias", "band mean p95", "wrong%", "cover%", "gather",
              "band ms");
  for (const ViewedScene& scene : StandardScenes()) {
    if (!only.empty() && scene.scene.name() != only) continue;
    for (int seed = 0; seed < seeds; ++seed) {
      const ViewedScene placed = scene.Moved(RandomPose(100 + seed, 20.0));
      const FusedBand fused = FuseScene(placed, run);
      Print(scene.scene.name(), MeasureBand(fused, placed.scene, run.fusion), run.voxel_size_m,
            fused.gather_ms, fused.band_ms);
    }
  }
  return 0;
}

}  // namespace
}  // namespace clearance::testing

int main(int argc, char** argv) { return clearance::testing::Run(argc, argv); }
