// Maps a sequence folder with other choices than the defaults, and answers points, so that each
// choice can be compared with the truth:
//   map_variant SEQUENCE --out DIR [--points FILE] [--frames N] [--kernel se|matern|rq] [--length
//   VOXELS]
//               [--max-weight W] [--constant-weights]
// FILE and the answers are raw little-endian doubles. Writes to DIR
//   object_J.ply   the mesh of every object, in W at the last frame
//   answers.f64    rows of three: the distance that the map answers; to the nearest sub-voxel site;
//   to
//                  the nearest centre of a voxel that holds one (the last two unsigned)
// and prints the integration's median time per frame, ms.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "server/esdf/exact_transform.h"
#include "server/esdf/field_updater.h"
#include "server/integration/frame_integrator.h"
#include "server/map/world_map.h"
#include "server/query/block_mesher.h"
#include "server/query/object_index.h"
#include "server/query/point_query.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::evaluation {
namespace {

struct Arguments {
  std::string sequence, points, kernel = "se";
  std::filesystem::path out;
  int frames = 1 << 30;
  GpOptions gp;
  FusionOptions fusion;
  bool constant_weights = false;
};

void ForgetWeights(BandObservations& band) {
  std::fill(band.weight.begin(), band.weight.end(), 1.f);
}

// What the observations of all frames become when fused with `fusion`. The observations themselves
// are those of a map with the default cap.
struct Fused {
  MapConfig config;
  FusionOptions fusion;
  SurfaceMap static_map;
  std::map<ObjectId, SurfaceMap> objects;  // in L
  std::map<ObjectId, Pose> T_W_L;          // at the last frame

  void Add(const MapUpdate& update) {
    static_map.Apply(update.static_surface, fusion);
    for (const ObjectUpdate& object : update.objects) {
      if (object.event == ObjectEvent::kCreated) objects.erase(object.id);
      const auto [it, fresh] = objects.try_emplace(object.id, config.voxel_size_m);
      it->second.Apply(object.surface, fusion);
    }
  }
};

Fused Fuse(const Arguments& args, const testing::SequenceFolder& sequence) {
  MapConfig config;
  config.voxel_size_m = sequence.voxel_size_m;
  config.max_range_m = sequence.max_range_m;
  IntegratorOptions options = IntegratorOptions::For(config);
  options.band.gp = args.gp;
  const FrameIntegrator integrator(options);
  WorldMap map(config);
  Fused fused{config, args.fusion, SurfaceMap(config.voxel_size_m), {}, {}};
  std::vector<double> ms;
  for (int k = 0; k < std::min(args.frames, sequence.size()); ++k) {
    const Frame frame = ReadFrame(sequence, k);
    const auto start = std::chrono::steady_clock::now();
    auto update = integrator.Integrate(frame, map);
    ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
                     .count());
    if (!update.ok()) throw std::runtime_error(std::string(update.status().message()));
    if (args.constant_weights) {
      ForgetWeights(update->static_surface.band);
      for (ObjectUpdate& object : update->objects) ForgetWeights(object.surface.band);
    }
    map.Apply(*update);
    fused.Add(*update);
  }
  for (const auto& [id, object] : map.objects()) {
    fused.T_W_L[id] = object.CoastedTo(map.stamp_ns());
  }
  std::nth_element(ms.begin(), ms.begin() + ms.size() / 2, ms.end());
  std::printf("%.3f\n", ms[ms.size() / 2]);
  return fused;
}

void WriteMeshes(const Fused& fused, const std::filesystem::path& out) {
  for (const auto& [id, surface] : fused.objects) {
    if (!fused.T_W_L.contains(id)) continue;  // retired
    MesherOptions options;
    options.min_weight = fused.fusion.min_weight;
    BlockMesher mesher(options);
    mesher.MarkAll(surface);
    const Mesh mesh = Transformed(mesher.Extract(surface), fused.T_W_L.at(id));
    std::ofstream(out / ("object_" + std::to_string(id.value()) + ".ply"), std::ios::binary)
        << WritePly(mesh);
  }
}

Eigen::Matrix3Xd ReadPoints(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) throw std::runtime_error("cannot read " + path);
  const auto bytes = static_cast<size_t>(in.tellg());
  Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(bytes / (3 * sizeof(double))));
  in.seekg(0);
  in.read(reinterpret_cast<char*>(points.data()), points.size() * sizeof(double));
  return points;
}

void Answer(const Fused& fused, const Eigen::Matrix3Xd& points, const std::filesystem::path& out) {
  const SurfaceMap& map = fused.static_map;
  FieldUpdater updater(fused.config, fused.fusion);
  MapView view;
  view.config = fused.config;
  view.field = updater.Update(map, map.BandBlocks());
  view.object_index = BuildObjectIndex(view.objects);
  QueryOptions options;
  options.layers.static_only = true;
  const DistanceBatch batch = QueryDistances(view, points, options);

  const double h = fused.config.voxel_size_m;
  std::vector<Eigen::Vector3d> sites, centres;
  std::vector<float> mean(kHaloVoxels), weight(kHaloVoxels);
  BlockSites found;
  for (const BlockIndex& block : map.BandBlocks()) {
    map.ReadBand(block, mean.data(), weight.data());
    ExtractSites(mean.data(), weight.data(), static_cast<float>(h), fused.fusion.min_weight,
                 &found);
    for (int o = 0; o < kBlockVoxels; ++o) {
      if (!Test(found.mask, o)) continue;
      centres.push_back(VoxelCentre(VoxelAt(block, o), h));
      sites.push_back(centres.back() + found.site[o].to_site_voxels().cast<double>() * h);
    }
  }
  const ExactTransform to_sites(sites, h, 2 * view.config.max_distance_m);
  const ExactTransform to_centres(centres, h, 2 * view.config.max_distance_m);
  std::ofstream file(out / "answers.f64", std::ios::binary);
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Eigen::Vector3d p = points.col(i);
    const double row[3] = {batch.distances_m[i], to_sites.Find(p).distance_m,
                           to_centres.Find(p).distance_m};
    file.write(reinterpret_cast<const char*>(row), sizeof(row));
  }
}

int Main(int argc, char** argv) {
  CLI::App app{"Maps a sequence with other choices than the defaults"};
  Arguments args;
  const std::map<std::string, KernelType> kernels = {{"se", KernelType::kSquaredExponential},
                                                     {"matern", KernelType::kMatern32},
                                                     {"rq", KernelType::kRationalQuadratic}};
  app.add_option("sequence", args.sequence)->required();
  app.add_option("--out", args.out)->required();
  app.add_option("--points", args.points);
  app.add_option("--frames", args.frames)->check(CLI::PositiveNumber);
  app.add_option("--kernel", args.kernel)->check(CLI::IsMember({"se", "matern", "rq"}));
  app.add_option("--length", args.gp.length_scale_voxels)->check(CLI::PositiveNumber);
  app.add_option("--max-weight", args.fusion.max_weight)->check(CLI::PositiveNumber);
  app.add_flag("--constant-weights", args.constant_weights);
  CLI11_PARSE(app, argc, argv);
  args.gp.kernel = kernels.at(args.kernel);
  std::filesystem::create_directories(args.out);
  const Fused fused = Fuse(args, testing::OpenSequence(args.sequence));
  WriteMeshes(fused, args.out);
  if (!args.points.empty()) Answer(fused, ReadPoints(args.points), args.out);
  return 0;
}

}  // namespace
}  // namespace clearance::evaluation

int main(int argc, char** argv) {
  try {
    return clearance::evaluation::Main(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "map_variant: %s\n", error.what());
    return 1;
  }
}
