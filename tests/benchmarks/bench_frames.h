// What the benchmarks share: decoded frames, the map configuration of a sequence, percentiles.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/core/frame.h"
#include "server/map/map_config.h"

namespace clearance::bench {

struct Recording {
  std::string name;
  MapConfig config;
  std::vector<Frame> frames;  // in memory: decoding is nobody's time
};

// The first `count` frames of a sequence folder. The field's reach is `max_distance_m`.
absl::StatusOr<Recording> LoadRecording(const std::string& folder, size_t count,
                                        double max_distance_m);

// The value below which `share` of the values lie; 0 without values.
double Percentile(std::vector<double> values, double share);

// The value of --NAME=VALUE, which is taken out of the arguments; `otherwise` where it is missing.
std::string TakeFlag(int* argc, char** argv, const std::string& name, std::string otherwise);

// Resident memory of a process (/proc/PID/status), bytes; 0 where it cannot be read.
uint64_t ResidentBytes(int pid);

// A street 24 m wide between two facades that ends `end_m` ahead, seen by a level 1280x720 depth
// camera 1.6 m above the ground: exact depth, so that any range can be asked for.
Frame CanyonFrame(uint64_t index, double end_m);

}  // namespace clearance::bench
