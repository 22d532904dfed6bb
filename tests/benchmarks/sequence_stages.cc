// Times of a frame's stages in process, without a server: sequence_stages SEQUENCE [MAX_DISTANCE_M]
// [FRAMES]. Frames are decoded beforehand.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "client/sequence/sequence.h"
#include "server/engine/live_map.h"

namespace {

double Percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[static_cast<size_t>(share * (values.size() - 1))];
}

}  // namespace

int main(int argc, char** argv) {
  using namespace clearance;
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s SEQUENCE [MAX_DISTANCE_M] [FRAMES]\n", argv[0]);
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
  LiveMap map(config);
  std::map<std::string, std::vector<double>> stages;
  std::vector<std::string> order;
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
    double sum = 0;
    for (const auto& [name, ms] : done->stages) {
      if (stages[name].empty()) order.push_back(name);
      stages[name].push_back(ms);
      sum += ms;
    }
    if (stages["sum"].empty()) order.push_back("sum");
    stages["sum"].push_back(sum);
  }
  std::printf("%s: %lu frames, %g m voxels, field to %g m\n%-16s %9s %9s %9s\n",
              sequence->Id().c_str(), static_cast<unsigned long>(frames), config.voxel_size_m,
              config.max_distance_m, "stage", "median ms", "p95 ms", "max ms");
  for (const std::string& name : order) {
    std::printf("%-16s %9.2f %9.2f %9.2f\n", name.c_str(), Percentile(stages[name], 0.5),
                Percentile(stages[name], 0.95), Percentile(stages[name], 1));
  }
  const MapSizes sizes = map.Sizes();
  std::printf("memory %.1f MB, %lu field blocks\n", sizes.memory_bytes * 1e-6,
              static_cast<unsigned long>(sizes.field_blocks));
  return 0;
}
