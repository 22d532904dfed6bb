// clearance_sim: writes a simulated recording as a sequence folder, or exact distances in it.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

#include "planner_demo/sequence/sequence_writer.h"
#include "planner_demo/sim/scenes/scenes.h"

namespace {

// Exact distances of the points of a file (lines x,y,z; other lines are skipped) at one time.
absl::Status WriteDistances(const clearance::sim::Scene& scene, const std::string& points,
                            double time_s, const std::string& path) {
  std::ifstream in(points);
  if (!in) return absl::NotFoundError("cannot read " + points);
  std::ofstream out(path);
  out << "x,y,z,distance_m,object_id\n";
  out.precision(9);
  for (std::string line; std::getline(in, line);) {
    for (char& c : line) c = c == ',' ? ' ' : c;
    std::istringstream numbers(line);
    Eigen::Vector3d point_W;
    if (!(numbers >> point_W.x() >> point_W.y() >> point_W.z())) continue;
    int mover = -1;
    const double distance_m = clearance::sim::TrueDistance(scene, point_W, time_s, &mover);
    out << point_W.x() << ',' << point_W.y() << ',' << point_W.z() << ',' << distance_m << ','
        << (mover < 0 ? 0 : scene.movers[mover].id) << '\n';
  }
  out.close();
  return out.good() ? absl::OkStatus() : absl::UnavailableError("cannot write " + path);
}

}  // namespace

int main(int argc, char** argv) {
  using clearance::sim::SceneNames;
  CLI::App app("Writes a simulated recording with ground truth as a sequence folder.");
  std::string name;
  std::string folder;
  int frames = 0;
  clearance::sim::SequenceOptions options;
  auto& noise = options.noise;
  app.add_option("--scene", name, "which scene")->required()->check(CLI::IsMember(SceneNames()));
  app.add_option("--out", folder, "the folder to write, or the file of --distances-of")->required();
  std::string points;
  double time_s = 0.0;
  auto* distances = app.add_option("--distances-of", points,
                                   "write the exact distances of these points (x,y,z lines) "
                                   "instead of a recording");
  app.add_option("--at", time_s, "time in seconds of --distances-of, futures too")
      ->needs(distances);
  app.add_option("--seed", options.seed, "names one variant of the scene")->capture_default_str();
  app.add_option("--frames", frames, "number of frames (default: the scene's own)")
      ->check(CLI::Range(1, 1000000));
  app.add_option("--depth-noise-m", noise.depth_sigma_m, "standard deviation of each return")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--motion-noise-m", noise.motion_sigma_m, "standard deviation of each motion")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--label-shrink-px", noise.label_shrink_px, "labels too small by so many pixels")
      ->check(CLI::Range(0, 100));
  app.add_option("--label-grow-px", noise.label_grow_px, "labels too large by so many pixels")
      ->check(CLI::Range(0, 100));
  app.add_option("--late-labels-frames", noise.late_label_frames,
                 "objects stay unlabelled in their first frames in view")
      ->check(CLI::NonNegativeNumber);
  bool quiet = false;
  app.add_flag("--quiet", quiet, "print nothing but errors");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }

  options.source = "simulated: clearance_sim";
  for (int i = 1; i < argc; ++i) {
    if (std::string(argv[i]) == "--out") {
      ++i;  // where it lies does not change what it is
      continue;
    }
    options.source += std::string(" ") + argv[i];
  }
  const auto scene = clearance::sim::MakeScene(name, options.seed, frames);
  if (!points.empty()) {
    const absl::Status status = WriteDistances(*scene, points, time_s, folder);
    if (status.ok()) return 0;
    std::fprintf(stderr, "clearance_sim: %s\n", std::string(status.message()).c_str());
    return 1;
  }
  if (!quiet) {
    options.progress = [&scene](int frame) {
      std::fprintf(stderr, "\r%s: frame %d of %d", scene->name.c_str(), frame + 1,
                   scene->frame_count);
    };
  }
  const absl::Status status = clearance::sim::WriteSequence(*scene, options, folder);
  if (!quiet) std::fprintf(stderr, "\n");
  if (status.ok()) return 0;
  std::fprintf(stderr, "clearance_sim: %s\n", std::string(status.message()).c_str());
  return 1;
}
