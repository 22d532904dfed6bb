// Times of a frame's stages in process, without a server: sequence_stages [--wall] SEQUENCE
// [MAX_DISTANCE_M] [FRAMES] [THREADS]. Frames are decoded beforehand and not counted. CPU time of
// all threads, which other programs on the machine disturb less than the wall clock of --wall.
// Ends with a fingerprint of the map: equal maps have equal ones.
#include <tbb/global_control.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "client/sequence/sequence.h"
#include "server/engine/live_map.h"
#include "server/map/surface_grids.h"

namespace {

using namespace clearance;

double CpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

double Percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[static_cast<size_t>(share * (values.size() - 1))];
}

// FNV-1a over bytes: the same in every run, unlike absl's hash.
class Fingerprint {
 public:
  template <typename T>
  void Add(const T& value) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(&value);
    for (size_t i = 0; i < sizeof(T); ++i) hash_ = (hash_ ^ bytes[i]) * 0x100000001b3u;
  }
  template <typename Grid>
  void AddGrid(const Grid& grid) {
    for (auto value = grid.cbeginValueOn(); value; ++value) {
      Add(value.getCoord().x());
      Add(value.getCoord().y());
      Add(value.getCoord().z());
      Add(*value);
    }
  }
  void AddSurface(const SurfaceMap& map) {
    AddGrid(*map.grids().mean);
    AddGrid(*map.grids().weight);
    AddGrid(*map.grids().evidence);
  }
  uint64_t value() const { return hash_; }

 private:
  uint64_t hash_ = 0xcbf29ce484222325u;
};

struct Stages {
  std::map<std::string, std::vector<double>> ms;
  std::vector<std::string> order;

  void Add(const std::string& name, double value) {
    if (ms[name].empty()) order.push_back(name);
    ms[name].push_back(value);
  }
  void Add(const StageTimes& times) {
    double sum = 0;
    for (const auto& [name, value] : times) {
      Add(name, value);
      if (name == "integrate" || name == "apply" || name == "field" || name == "shapes") {
        sum += value;
      }
    }
    Add("sum", sum);
  }
};

}  // namespace

int main(int argc, char** argv) {
  const bool wall = argc > 1 && std::string_view(argv[1]) == "--wall";
  if (wall) --argc, ++argv;
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s [--wall] SEQUENCE [MAX_DISTANCE_M] [FRAMES] [THREADS]\n",
                 argv[0]);
    return 2;
  }
  const auto sequence = client::Sequence::Open(argv[1]);
  if (!sequence.ok()) {
    std::fprintf(stderr, "%s\n", sequence.status().ToString().c_str());
    return 4;
  }
  MapConfig config;
  config.voxel_size_m = sequence->info().voxel_size_m.value_or(0.1);
  config.max_range_m = sequence->info().max_range_m > 0 ? sequence->info().max_range_m : 25;
  config.max_distance_m = argc > 2 ? std::atof(argv[2]) : 2.0;
  const uint64_t frames =
      std::min<uint64_t>(sequence->size(), argc > 3 ? std::atoi(argv[3]) : sequence->size());
  const int threads = argc > 4 ? std::atoi(argv[4])
                               : static_cast<int>(tbb::global_control::active_value(
                                     tbb::global_control::max_allowed_parallelism));
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
  LiveMap map(config, wall ? WallMs : CpuMs);
  Stages stages;
  for (uint64_t k = 0; k < frames; ++k) {
    auto frame = sequence->Read(k);
    if (!frame.ok()) {
      std::fprintf(stderr, "%s\n", frame.status().ToString().c_str());
      return 4;
    }
    frame->source_id = "benchmark";
    frame->max_range_m = config.max_range_m;
    const auto done = map.Integrate(*frame);
    if (!done.ok()) {
      std::fprintf(stderr, "%s\n", done.status().ToString().c_str());
      return 4;
    }
    stages.Add(done->stages);
  }
  std::printf("%s: %lu frames, %g m voxels, field to %g m, %d threads\n%-12s %9s %9s %9s\n",
              sequence->Id().c_str(), static_cast<unsigned long>(frames), config.voxel_size_m,
              config.max_distance_m, threads, wall ? "wall ms" : "cpu ms", "median", "p95", "max");
  for (const std::string& name : stages.order) {
    std::printf("%-12s %9.2f %9.2f %9.2f\n", name.c_str(), Percentile(stages.ms[name], 0.5),
                Percentile(stages.ms[name], 0.95), Percentile(stages.ms[name], 1));
  }
  const MapSizes sizes = map.Sizes();
  std::printf("memory %.1f MB, %lu field blocks\n", sizes.memory_bytes * 1e-6,
              static_cast<unsigned long>(sizes.field_blocks));
  Fingerprint fingerprint;
  fingerprint.AddSurface(map.world().static_map());
  for (const auto& [id, object] : map.world().objects()) fingerprint.AddSurface(object.surface());
  std::printf("fingerprint %016lx\n", static_cast<unsigned long>(fingerprint.value()));
  return 0;
}
