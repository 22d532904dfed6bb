// What Debian packages for the same job, on the same frames in the same run: OctoMap with
// dynamicEDT3D, and OpenVDB's own level-set tools. Nothing of these is part of the server.
//   peers_benchmark --data=FOLDER --frames=3
#include <benchmark/benchmark.h>
#include <dynamicEDT3D/dynamicEDTOctomap.h>
#include <octomap/octomap.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/FastSweeping.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/ParticlesToLevelSet.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>
#include <variant>

#include "tests/benchmarks/bench_frames.h"

namespace clearance::bench {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kReach_m = 2;
constexpr int kPoints = 20'000;

double MsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Static returns of a frame in the world, none left out.
std::vector<Eigen::Vector3f> StaticPoints(const Frame& frame) {
  std::vector<Eigen::Vector3f> points;
  const auto* image = std::get_if<DepthImage>(&frame.observation);
  if (image == nullptr) return points;
  for (uint32_t v = 0; v < image->height; ++v) {
    for (uint32_t u = 0; u < image->width; ++u) {
      const size_t i = size_t{v} * image->width + u;
      if (image->depth[i] == 0 || (!image->labels.empty() && image->labels[i] != 0)) continue;
      const double z = image->depth[i] * image->depth_scale_m;
      if (z > frame.max_range_m) continue;
      const Eigen::Vector3d p_X(z * (u - image->cx) / image->fx, z * (v - image->cy) / image->fy,
                                z);
      points.push_back((frame.T_W_X * p_X).cast<float>());
    }
  }
  return points;
}

std::vector<Eigen::Vector3d> RandomPoints(const Recording& recording) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < kPoints; ++i) {
    points.push_back(recording.frames[0].T_W_X *
                     Eigen::Vector3d(8 * unit(rng), 1.5 * unit(rng), 10 + 9 * unit(rng)));
  }
  return points;
}

template <typename Ask>
double NsPerPoint(const std::vector<Eigen::Vector3d>& points, const Ask& ask) {
  std::vector<double> ns;
  for (int k = 0; k < 7; ++k) {
    const Clock::time_point start = Clock::now();
    for (const Eigen::Vector3d& p : points) benchmark::DoNotOptimize(ask(p));
    ns.push_back(MsSince(start) * 1e6 / static_cast<double>(points.size()));
  }
  return Percentile(ns, 0.5);
}

void OctoMap(benchmark::State& state, const Recording& recording) {
  for (auto _ : state) {
    const double h = recording.config.voxel_size_m;
    const uint64_t before = ResidentBytes(getpid());
    octomap::OcTree tree(h);
    tree.enableChangeDetection(true);
    std::unique_ptr<DynamicEDTOctomap> field;
    std::vector<double> integrate, update;
    for (const Frame& frame : recording.frames) {
      octomap::Pointcloud cloud;
      for (const Eigen::Vector3f& p : StaticPoints(frame)) cloud.push_back(p.x(), p.y(), p.z());
      const Eigen::Vector3d eye = frame.T_W_X.translation();
      Clock::time_point start = Clock::now();
      tree.insertPointCloud(cloud, octomap::point3d(eye.x(), eye.y(), eye.z()), -1);
      integrate.push_back(MsSince(start));
      start = Clock::now();
      const bool first = field == nullptr;
      if (first) {  // a fixed box: all that the camera can reach
        const float reach = static_cast<float>(recording.config.max_range_m);
        const octomap::point3d c(eye.x(), eye.y(), eye.z());
        field =
            std::make_unique<DynamicEDTOctomap>(kReach_m, &tree, c - octomap::point3d(3, reach, 3),
                                                c + octomap::point3d(reach + 10, reach, 9), false);
      }
      field->update();
      if (!first) update.push_back(MsSince(start));
    }
    state.counters["integrate_ms"] = Percentile(integrate, 0.5);
    state.counters["field_ms"] = Percentile(update, 0.5);
    state.counters["query_ns"] = NsPerPoint(RandomPoints(recording), [&](const Eigen::Vector3d& p) {
      float distance = 0;
      octomap::point3d nearest;
      const octomap::point3d at(p.x(), p.y(), p.z());
      field->getDistanceAndClosestObstacle(at, distance, nearest);
      const octomap::point3d gradient = (at - nearest).normalized();
      return distance + gradient.x();
    });
    double voxels = 0;  // leaves, the large ones expanded
    for (auto leaf = tree.begin_leafs(); leaf != tree.end_leafs(); ++leaf) {
      voxels += std::pow(leaf.getSize() / h, 3);
    }
    state.counters["bytes_per_voxel"] =
        static_cast<double>(ResidentBytes(getpid()) - before) / voxels;
  }
}

struct Particles {
  using PosType = openvdb::Vec3R;
  std::vector<Eigen::Vector3f> points;
  size_t size() const { return points.size(); }
  void getPos(size_t n, openvdb::Vec3R& xyz) const {
    xyz = {points[n].x(), points[n].y(), points[n].z()};
  }
};

void OpenVdb(benchmark::State& state, const Recording& recording) {
  openvdb::initialize();
  for (auto _ : state) {
    const double h = recording.config.voxel_size_m;
    // One frame from nothing: these tools have no update.
    const Particles particles{StaticPoints(recording.frames[0])};
    auto grid = openvdb::createLevelSet<openvdb::FloatGrid>(h, 3);
    Clock::time_point start = Clock::now();
    openvdb::tools::particlesToSdf(particles, *grid, 1.5 * h);
    state.counters["band_ms"] = MsSince(start);
    start = Clock::now();
    const auto wide = openvdb::tools::dilateSdf(*grid, static_cast<int>(kReach_m / h) - 3);
    state.counters["field_ms"] = MsSince(start);
    const auto accessor = wide->getConstAccessor();
    const openvdb::tools::GridSampler<openvdb::FloatGrid::ConstAccessor, openvdb::tools::BoxSampler>
        sampler(accessor, wide->transform());
    const auto points = RandomPoints(recording);
    state.counters["query_ns"] = NsPerPoint(points, [&](const Eigen::Vector3d& p) {
      const openvdb::Vec3d at(p.x(), p.y(), p.z());
      openvdb::Vec3d gradient;
      for (int axis = 0; axis < 3; ++axis) {
        openvdb::Vec3d step(0, 0, 0);
        step[axis] = 0.5 * h;
        gradient[axis] = sampler.wsSample(at + step) - sampler.wsSample(at - step);
      }
      return sampler.wsSample(at) + gradient[0];
    });
    state.counters["distance_only_ns"] = NsPerPoint(points, [&](const Eigen::Vector3d& p) {
      return sampler.wsSample(openvdb::Vec3d(p.x(), p.y(), p.z()));
    });
  }
}

}  // namespace
}  // namespace clearance::bench

int main(int argc, char** argv) {
  using namespace clearance::bench;
  const std::string folder = TakeFlag(&argc, argv, "data", ".") + "/street";
  const size_t frames = std::stoul(TakeFlag(&argc, argv, "frames", "3"));
  const auto recording = LoadRecording(folder, frames, 2);
  if (!recording.ok()) {
    std::fprintf(stderr, "peers_benchmark: %s\n", recording.status().ToString().c_str());
    return 1;
  }
  for (const auto& [name, run] : {std::pair{"OctoMap", OctoMap}, std::pair{"OpenVdb", OpenVdb}}) {
    benchmark::RegisterBenchmark(
        name, [&, run = run](benchmark::State& state) { run(state, *recording); })
        ->Iterations(1)
        ->Unit(benchmark::kMillisecond);
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
