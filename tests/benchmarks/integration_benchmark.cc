// From a frame to a published view, in process: the stages on recorded sequences, what one object
// costs, and how time grows with the map, with the number of objects and with the sensor's range.
//   integration_benchmark --data=FOLDER --sequences=street,hall --frames=20 [--repeats=100]
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "server/engine/live_map.h"
#include "server/engine/map_store.h"
#include "server/query/point_query.h"
#include "tests/benchmarks/bench_frames.h"
#include "tests/query/query_fixture.h"

namespace clearance::bench {
namespace {

using Clock = std::chrono::steady_clock;

struct Flags {
  std::string data;
  size_t frames = 20;
  int repeats = 100;
};

double MsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// A map and the views that a server would keep: old ones are freed while new ones are made.
class Publisher {
 public:
  explicit Publisher(const MapConfig& config) : map_(config), config_(config) {}

  // Stage times of one frame; the view is published under "publish".
  StageTimes Take(const Frame& frame) {
    const auto done = map_.Integrate(frame);
    if (!done.ok()) {
      std::fprintf(stderr, "%s\n", done.status().ToString().c_str());
      std::exit(1);
    }
    StageTimes stages = done->stages;
    const Clock::time_point start = Clock::now();
    auto view = std::make_shared<MapView>(map_.View());
    view->config = config_;
    views_.push_back(std::move(view));
    if (views_.size() > kKeptViews) views_.erase(views_.begin());
    stages.emplace_back("publish", MsSince(start));
    return stages;
  }

  const MapView& view() const { return *views_.back(); }
  LiveMap& map() { return map_; }

 private:
  static constexpr size_t kKeptViews = 8;
  LiveMap map_;
  MapConfig config_;
  std::vector<std::shared_ptr<const MapView>> views_;
};

// Stages may be listed in finer parts, too: these make up a frame.
double Total(const StageTimes& stages) {
  double sum = 0;
  for (const auto& [name, ms] : stages) {
    for (const char* part : {"integrate", "apply", "field", "shapes", "publish"}) {
      if (name == part) sum += ms;
    }
  }
  return sum;
}

Recording LoadOrExit(const std::string& folder, size_t frames, double max_distance_m) {
  auto recording = LoadRecording(folder, frames, max_distance_m);
  if (!recording.ok()) {
    std::fprintf(stderr, "%s\n", recording.status().ToString().c_str());
    std::exit(1);
  }
  return *std::move(recording);
}

// Voxels that are not unknown, tiles expanded.
uint64_t KnownVoxels(const DistanceField& field) {
  uint64_t known = 0;
  field.ForEach(
      [&](const BlockIndex&, const std::shared_ptr<const FieldBlock>& block, uint8_t tile) {
        if (block) {
          for (const FieldVoxel& v : block->voxels) known += v.state() != VoxelState::kUnknown;
        } else if (tile != DistanceField::kNoTile) {
          known += (tile & 3) != 0 ? kBlockVoxels : 0;
        }
      });
  return known;
}

void Stages(benchmark::State& state, const std::string& folder, size_t frames,
            double max_distance_m) {
  const Recording recording = LoadOrExit(folder, frames, max_distance_m);
  for (auto _ : state) {
    Publisher map(recording.config);
    std::map<std::string, std::vector<double>> stages;
    for (const Frame& frame : recording.frames) {
      const StageTimes times = map.Take(frame);
      for (const auto& [name, ms] : times) stages[name].push_back(ms);
      stages["frame"].push_back(Total(times));
    }
    for (const auto& [name, ms] : stages) state.counters[name + "_ms"] = Percentile(ms, 0.5);
    state.counters["frame_p95_ms"] = Percentile(stages["frame"], 0.95);
    const MapSizes sizes = map.map().Sizes();
    const uint64_t known = KnownVoxels(map.view().field);
    state.counters["known_voxels"] = static_cast<double>(known);
    state.counters["counted_bytes_per_voxel"] = static_cast<double>(sizes.memory_bytes) / known;
  }
  state.counters["frames"] = static_cast<double>(recording.frames.size());
}

void ByRange(benchmark::State& state) {
  const auto range_m = static_cast<double>(state.range(0));
  for (auto _ : state) {
    MapConfig config;
    config.max_range_m = range_m;
    config.max_distance_m = 2;
    Publisher map(config);
    std::vector<double> total, field;
    for (uint64_t k = 0; k < 8; ++k) {
      const StageTimes times = map.Take(CanyonFrame(k, 120));
      if (k < 2) continue;
      total.push_back(Total(times));
      for (const auto& [name, ms] : times) {
        if (name == "field") field.push_back(ms);
      }
    }
    state.counters["frame_ms"] = Percentile(total, 0.5);
    state.counters["field_ms"] = Percentile(field, 0.5);
  }
}

Eigen::Matrix3Xd PointsNear(const Pose& T_W_X, int count, uint32_t seed) {
  std::mt19937 rng(seed);
  Eigen::Matrix3Xd points(3, count);
  const Eigen::Vector3d reach(12, 12, 2);
  for (int i = 0; i < count; ++i) {
    points.col(i) = T_W_X.translation() + testing::RandomIn({-reach, reach}, rng);
  }
  return points;
}

double NsPerPoint(const MapView& view, const Eigen::Matrix3Xd& points) {
  std::vector<double> ns;
  for (int k = 0; k < 9; ++k) {
    const Clock::time_point start = Clock::now();
    benchmark::DoNotOptimize(QueryDistances(view, points, {.gradients = true, .parallel = false}));
    ns.push_back(MsSince(start) * 1e6 / static_cast<double>(points.cols()));
  }
  return Percentile(ns, 0.5);
}

// The same three frames again and again, each time in new space a whole number of blocks away: the
// work is the same and only the map grows. Objects are left out.
void ByMapSize(benchmark::State& state, const std::string& folder, int repeats) {
  Recording recording = LoadOrExit(folder, 3, 2);
  for (Frame& frame : recording.frames) {
    if (auto* image = std::get_if<DepthImage>(&frame.observation)) image->labels.clear();
    frame.motions.clear();
  }
  const double shift_m = 1024 * recording.config.voxel_size_m;
  const int per_frame = static_cast<int>(recording.frames.size());
  for (auto _ : state) {
    Publisher map(recording.config);
    std::vector<double> first, last;
    double first_query = 0, last_query = 0;
    const auto points = PointsNear(recording.frames[0].T_W_X, 20000, 5);
    const int window = std::max(1, repeats / 10);
    for (int k = 0; k < repeats; ++k) {
      double sum = 0;
      for (int i = 0; i < per_frame; ++i) {
        Frame frame = recording.frames[i];
        frame.frame_id = static_cast<uint64_t>(k * per_frame + i);
        frame.stamp_ns = static_cast<int64_t>(frame.frame_id) * 100'000'000;
        frame.T_W_X.translation().y() += shift_m * (k % 10);
        frame.T_W_X.translation().x() += shift_m * (k / 10);
        sum += Total(map.Take(frame));
      }
      if (k > 0 && k <= window) first.push_back(sum / per_frame);
      if (k >= repeats - window) last.push_back(sum / per_frame);
      if (k == 0) first_query = NsPerPoint(map.view(), points);
    }
    last_query = NsPerPoint(map.view(), points);
    state.counters["first_frame_ms"] = Percentile(first, 0.5);
    state.counters["last_frame_ms"] = Percentile(last, 0.5);
    state.counters["frame_ratio"] = Percentile(last, 0.5) / Percentile(first, 0.5);
    state.counters["first_query_ns"] = first_query;
    state.counters["last_query_ns"] = last_query;
    state.counters["query_ratio"] = last_query / first_query;
  }
  state.counters["repeats"] = repeats;
}

}  // namespace
}  // namespace clearance::bench

int main(int argc, char** argv) {
  using namespace clearance::bench;
  Flags flags;
  flags.data = TakeFlag(&argc, argv, "data", ".");
  flags.frames = std::stoul(TakeFlag(&argc, argv, "frames", "20"));
  flags.repeats = std::stoi(TakeFlag(&argc, argv, "repeats", "100"));
  std::istringstream names(TakeFlag(&argc, argv, "sequences", "street"));
  for (std::string name; std::getline(names, name, ',');) {
    const std::string folder = flags.data + "/" + name;
    for (const int reach_m : {2, 5}) {
      benchmark::RegisterBenchmark(
          ("Stages/" + name + "/reach_m:" + std::to_string(reach_m)).c_str(),
          [=](benchmark::State& state) { Stages(state, folder, flags.frames, reach_m); })
          ->Iterations(1)
          ->Unit(benchmark::kMillisecond);
    }
    if (name != "street") continue;
    benchmark::RegisterBenchmark(
        "ByMapSize/street",
        [=](benchmark::State& state) { ByMapSize(state, folder, flags.repeats); })
        ->Iterations(1)
        ->Unit(benchmark::kMillisecond);
  }
  benchmark::RegisterBenchmark("ByRange", ByRange)
      ->Arg(10)
      ->Arg(25)
      ->Arg(50)
      ->Arg(100)
      ->Iterations(1)
      ->Unit(benchmark::kMillisecond);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
