// Integrates a sequence folder and writes every object's zero crossings as points in the world
// frame of the last frame: object_surfaces SEQUENCE OUT_DIR [--frames N] Each is
// OUT_DIR/object_J.ply, to be compared with the ground truth. Prints counts and times.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>

#include "server/integration/frame_integrator.h"
#include "server/map/world_map.h"
#include "server/query/block_mesher.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::testing {
namespace {

int Run(int argc, char** argv) {
  CLI::App app{"Surfaces of every object of a sequence"};
  std::string folder, out_dir;
  int frames = 1 << 30;
  double min_weight = FusionOptions{}.min_weight;
  IntegratorOptions defaults;
  app.add_option("sequence", folder)->required();
  app.add_option("out", out_dir)->required();
  app.add_option("--frames", frames, "first frames only");
  app.add_option("--min-weight", min_weight, "weight from which a voxel is read");
  app.add_option("--max-variance", defaults.band.gp.max_latent_variance, "largest latent variance");
  app.add_option("--length", defaults.band.gp.length_scale_voxels, "length scale, voxels");
  CLI11_PARSE(app, argc, argv);
  const SequenceFolder sequence = OpenSequence(folder);
  MapConfig config;
  config.voxel_size_m = sequence.voxel_size_m;
  config.max_range_m = sequence.max_range_m;
  IntegratorOptions options = IntegratorOptions::For(config);
  options.band.gp = defaults.band.gp;
  const FrameIntegrator integrator(options);
  WorldMap map(config);
  std::vector<double> ms;
  for (int k = 0; k < std::min(frames, sequence.size()); ++k) {
    const Frame frame = ReadFrame(sequence, k);
    const auto start = std::chrono::steady_clock::now();
    const auto update = integrator.Integrate(frame, map);
    if (!update.ok()) {
      std::fprintf(stderr, "frame %d: %s\n", k, std::string(update.status().message()).c_str());
      return 4;
    }
    map.Apply(*update);
    ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
                     .count());
  }
  std::sort(ms.begin(), ms.end());
  std::printf("%zu frames, integrate and apply %.1f ms median, %.1f p95\n", ms.size(),
              ms[ms.size() / 2], ms[ms.size() * 95 / 100]);
  std::filesystem::create_directories(out_dir);
  for (const auto& [id, object] : map.objects()) {
    MesherOptions mesher_options;
    mesher_options.min_weight = static_cast<float>(min_weight);
    BlockMesher mesher(mesher_options);
    mesher.MarkAll(object.surface());
    const Mesh mesh =
        Transformed(mesher.Extract(object.surface()), object.CoastedTo(map.stamp_ns()));
    const std::string name = "object_" + std::to_string(id.value()) + ".ply";
    std::ofstream(std::filesystem::path(out_dir) / name, std::ios::binary) << WritePly(mesh);
    std::printf("object %d: %zu vertices, seen in %llu frames\n", id.value(), mesh.vertices.size(),
                static_cast<unsigned long long>(object.observations()));
  }
  return 0;
}

}  // namespace
}  // namespace clearance::testing

int main(int argc, char** argv) { return clearance::testing::Run(argc, argv); }
