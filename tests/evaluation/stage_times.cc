// What each step of a frame costs, in process (the paper's Sec. IV-B): stage_times SEQUENCE
// [--frames N] Prints JSON, milliseconds by frame: the stages of LiveMap; "object", one value an
// object and frame (its voxels, the static surface it claims, its band); "static", the rest of
// "integrate"; "mesh", one value an object and frame (the mesh brought up to date). Frames are
// decoded beforehand.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "server/engine/live_map.h"
#include "server/integration/claimed_space.h"
#include "server/integration/label_split.h"
#include "server/integration/surface_band.h"
#include "tests/testing/sequence_folder.h"

namespace clearance::evaluation {
namespace {

class Stopwatch {
 public:
  double Ms() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_)
        .count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

using Times = std::map<std::string, std::vector<double>>;

// Repeats what FrameIntegrator did for each object of the frame that `map` has just integrated;
// the sum, ms.
double TimeObjects(const Frame& frame, const LiveMap& map, Times* times) {
  const MapConfig& config = map.world().config();
  const LabelSplit split = SplitByLabel(frame, config.max_range_m, config.bounds);
  if (split.object_points.empty()) return 0;
  const double h = config.voxel_size_m;
  const RangeImage image =
      std::holds_alternative<DepthImage>(frame.observation)
          ? RangeImage::FromDepth(std::get<DepthImage>(frame.observation), config.max_range_m)
          : RangeImage::FromCloud(std::get<PointCloud>(frame.observation),
                                  0.5 * h / config.max_range_m, config.max_range_m);
  const LocalVoxels static_W = GatherVoxels(split.points_X, split.static_points, frame.T_W_X, h);
  const IntegratorOptions options = IntegratorOptions::For(config);
  double sum = 0;
  for (const auto& [id, points] : split.object_points) {
    const auto object = map.world().objects().find(id);
    if (object == map.world().objects().end()) continue;
    const Stopwatch watch;
    const LocalVoxels claimed = GatherVoxels(split.points_X, points, frame.T_W_X, h);
    ReleaseClaimed(claimed, StaticReturns(static_W), map.world().static_map());
    const Pose T_L_X = object->second.T_W_L().inverse() * frame.T_W_X;
    ObserveBand(GatherVoxels(split.points_X, points, T_L_X, h), image, T_L_X, id,
                object->second.surface(), options.band);
    (*times)["object"].push_back(watch.Ms());
    sum += (*times)["object"].back();
  }
  return sum;
}

int Main(int argc, char** argv) {
  CLI::App app{"What each step of a frame costs"};
  std::string folder;
  int frames = 1 << 30;
  app.add_option("sequence", folder)->required();
  app.add_option("--frames", frames)->check(CLI::PositiveNumber);
  CLI11_PARSE(app, argc, argv);
  const testing::SequenceFolder sequence = testing::OpenSequence(folder);
  MapConfig config;
  config.voxel_size_m = sequence.voxel_size_m;
  config.max_range_m = sequence.max_range_m;
  LiveMap map(config);
  Times times;
  for (int k = 0; k < std::min(frames, sequence.size()); ++k) {
    const Frame frame = ReadFrame(sequence, k);
    const auto done = map.Integrate(frame);
    if (!done.ok()) throw std::runtime_error(std::string(done.status().message()));
    double integrate = 0, all = 0;
    for (const auto& [stage, ms] : done->stages) {
      times[stage].push_back(ms);
      if (stage == "integrate") integrate = ms;
      all += ms;
    }
    times["all stages"].push_back(all);
    times["static"].push_back(integrate - TimeObjects(frame, map, &times));
    for (const auto& [id, object] : map.world().objects()) {
      if (object.last_seen_ns() != map.world().stamp_ns()) continue;
      const Stopwatch watch;
      const auto mesh = map.ExtractMesh(id, 0);
      if (mesh.ok()) times["mesh"].push_back(watch.Ms());
    }
  }
  std::printf("%s\n", nlohmann::json(times).dump().c_str());
  return 0;
}

}  // namespace
}  // namespace clearance::evaluation

int main(int argc, char** argv) {
  try {
    return clearance::evaluation::Main(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "stage_times: %s\n", error.what());
    return 1;
  }
}
