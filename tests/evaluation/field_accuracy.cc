// How exact and how fast the closest-site field is:
//   field_accuracy                      analytic scenes: site candidates, random changes
//   field_accuracy FOLDER [--frames N] [--max-distance-m D] [--threads N] [--voxel-size-m H]
//                                       a sequence folder: update times by stage, error against the
//                                       exact transform of the field's own and of the latest sites
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "server/esdf/exact_transform.h"
#include "server/esdf/field_updater.h"
#include "server/integration/frame_integrator.h"
#include "server/map/world_map.h"
#include "tests/esdf/exact_world.h"
#include "tests/evaluation/site_candidates.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::evaluation {
namespace {

using testing::CompareWithExact;
using testing::ExactWorld;
using testing::FieldErrors;

struct Arguments {
  std::string folder;
  int frames = 1 << 30, threads = 0;
  double max_distance_m = 5.0, voxel_size_m = 0;
};

Arguments Parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string arg = argv[i];
    const auto value = [&] {
      if (++i == argc) throw std::runtime_error(arg + " needs a value");
      return std::string(argv[i]);
    };
    if (arg == "--frames") {
      a.frames = std::stoi(value());
    } else if (arg == "--max-distance-m") {
      a.max_distance_m = std::stod(value());
    } else if (arg == "--voxel-size-m") {
      a.voxel_size_m = std::stod(value());
    } else if (arg == "--threads") {
      a.threads = std::stoi(value());
    } else if (arg.starts_with("--")) {
      throw std::runtime_error("unknown option " + arg);
    } else {
      a.folder = arg;
    }
  }
  return a;
}

double Quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<size_t>(q * values.size()))];
}

void PrintErrors(const char* name, const FieldErrors& e) {
  printf("%-34s %9zu voxels, phantoms %zu, missing %zu, error mean %.4f p99 %.3f max %.3f voxel\n",
         name, e.voxels, e.phantoms, e.missing, e.mean, e.p99, e.max);
}

// 100 random insertions, moves and deletions; the incremental field and one from scratch.
void RandomChanges() {
  printf("\nRandom changes (100 each), 10 cm voxels, 2 m:\n");
  for (uint32_t seed = 1; seed <= 4; ++seed) {
    std::mt19937 rng(seed);
    ExactWorld world(0.1);
    MapConfig config;
    config.voxel_size_m = 0.1;
    config.max_distance_m = 2.0;
    FieldUpdater updater(config, FusionOptions());
    DistanceField field;
    std::uniform_real_distribution<double> u(-1, 1);
    std::vector<double> times;
    for (int step = 0; step < 100; ++step) {
      auto& solids = world.solids();
      std::vector<Aabb> touched;
      if (solids.size() < 4 || rng() % 3 == 0) {
        solids.push_back(testing::RandomSolid(rng, Eigen::Vector3d::Zero(), 3.0));
        touched.push_back(world.Bounds(solids.back()));
      } else {
        const size_t i = rng() % solids.size();
        touched.push_back(world.Bounds(solids[i]));
        if (rng() % 2) {
          solids[i].T_W_P.translation() += Eigen::Vector3d(u(rng), u(rng), u(rng));
          touched.push_back(world.Bounds(solids[i]));
        } else {
          solids.erase(solids.begin() + static_cast<int64_t>(i));
        }
      }
      const std::vector<BlockIndex> changed = world.Show(touched);
      const auto start = std::chrono::steady_clock::now();
      field = updater.Update(world.map(), changed);
      times.push_back(
          std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
              .count());
    }
    PrintErrors("  incremental", CompareWithExact(field, updater.sites()));
    FieldUpdater scratch(config, FusionOptions());
    const DistanceField fresh = scratch.Update(world.map(), world.map().BandBlocks());
    PrintErrors("  from scratch", CompareWithExact(fresh, scratch.sites()));
    printf("  update median %.2f ms, p95 %.2f ms\n", Quantile(times, 0.5), Quantile(times, 0.95));
  }
}

// Error against the sites that a fresh extraction gives: what ignoring small moves costs.
void AgainstLatestSites(const DistanceField& field, const SurfaceMap& map) {
  MapConfig config;
  config.voxel_size_m = field.voxel_size_m();
  config.max_distance_m = field.max_distance_m();
  FieldUpdater latest(config, FusionOptions());
  latest.Update(map, map.BandBlocks());
  const double h = field.voxel_size_m();
  const ExactTransform exact(testing::SitePositions(latest.sites(), h), h, field.max_distance_m());
  std::vector<double> errors;
  std::mt19937 rng(1);
  field.ForEach([&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t) {
    if (!data) return;
    for (int k = 0; k < 4; ++k) {
      const int o = static_cast<int>(rng() % kBlockVoxels);
      const FieldVoxel& v = data->voxels[o];
      const auto nearest = exact.Find(VoxelCentre(VoxelAt(b, o), h));
      if (!v.has_site() || nearest.site < 0) continue;
      errors.push_back(std::abs(v.to_site_voxels().cast<double>().norm() - nearest.distance_m / h));
    }
  });
  printf("against the latest sites: |error| median %.3f p95 %.3f p99 %.3f max %.3f voxel (%zu)\n",
         Quantile(errors, 0.5), Quantile(errors, 0.95), Quantile(errors, 0.99),
         Quantile(errors, 1.0), errors.size());
}

void Sequence(const Arguments& args) {
  const testing::SequenceFolder sequence = testing::OpenSequence(args.folder);
  MapConfig config;
  config.voxel_size_m = args.voxel_size_m > 0 ? args.voxel_size_m : sequence.voxel_size_m;
  config.max_distance_m = args.max_distance_m;
  config.max_range_m = sequence.max_range_m;
  WorldMap map(config);
  const FrameIntegrator integrator(IntegratorOptions::For(config));
  FieldUpdater updater(config, map.fusion());
  DistanceField field;
  std::vector<DistanceField> published(8);  // as many revisions as readers may hold
  std::vector<double> total, extract, repair, seed, sweep, finish;
  printf(
      "frame changed extract fresh gone scan repair seed swept rounds written | ms: "
      "extract repair seed sweep finish total\n");
  for (int k = 0; k < std::min(args.frames, sequence.size()); ++k) {
    const Frame frame = testing::ReadFrame(sequence, k);
    const auto update = integrator.Integrate(frame, map);
    if (!update.ok()) throw std::runtime_error(std::string(update.status().message()));
    const AppliedChanges changes = map.Apply(*update);
    const auto start = std::chrono::steady_clock::now();
    field = updater.Update(map.static_map(), changes.static_blocks);
    published[static_cast<size_t>(k) % published.size()] = field;
    total.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count());
    const FieldUpdater::Stats& s = updater.stats();
    extract.push_back(s.extract_ms);
    repair.push_back(s.repair_ms);
    seed.push_back(s.seed_ms);
    sweep.push_back(s.sweep_ms);
    finish.push_back(s.finish_ms);
    printf(
        "%4d %6zu %6zu %6zu %6zu %6zu %6zu %6zu %6zu %3zu %6zu | %.1f %.1f %.1f %.1f %.1f %.1f\n",
        k, changes.static_blocks.size(), s.extracted_blocks, s.fresh_sites, s.gone_sites,
        s.scanned_blocks, s.repaired_blocks, s.seeded_blocks, s.swept_blocks, s.rounds,
        s.written_blocks, s.extract_ms, s.repair_ms, s.seed_ms, s.sweep_ms, s.finish_ms,
        total.back());
  }
  const std::vector<double>* stages[] = {&extract, &repair, &seed, &sweep, &finish, &total};
  const char* names[] = {"extract", "repair", "seed", "sweep", "finish", "total"};
  for (int i = 0; i < 6; ++i) {
    printf("%-8s median %6.2f  p95 %6.2f ms\n", names[i], Quantile(*stages[i], 0.5),
           Quantile(*stages[i], 0.95));
  }
  printf("field %zu blocks, %.1f MB published, %.1f MB working\n", field.BlockCount(),
         static_cast<double>(field.MemoryBytes()) / 1e6,
         static_cast<double>(updater.MemoryBytes()) / 1e6);
  PrintErrors("against its own sites:", CompareWithExact(field, updater.sites(), 101));
  AgainstLatestSites(field, map.static_map());
}

int Main(int argc, char** argv) {
  const Arguments args = Parse(argc, argv);
  const tbb::global_control threads(
      tbb::global_control::max_allowed_parallelism,
      args.threads > 0
          ? static_cast<size_t>(args.threads)
          : tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  if (!args.folder.empty()) {
    Sequence(args);
  } else {
    PrintSiteCandidates();
    RandomChanges();
  }
  return 0;
}

}  // namespace
}  // namespace clearance::evaluation

int main(int argc, char** argv) {
  try {
    return clearance::evaluation::Main(argc, argv);
  } catch (const std::exception& e) {
    fprintf(stderr, "%s\n", e.what());
    return 1;
  }
}
