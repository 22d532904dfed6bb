#include "tests/benchmarks/bench_frames.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "client/sequence/sequence.h"

namespace clearance::bench {

absl::StatusOr<Recording> LoadRecording(const std::string& folder, size_t count,
                                        double max_distance_m) {
  const auto sequence = client::Sequence::Open(folder);
  if (!sequence.ok()) return sequence.status();
  Recording recording;
  recording.name = sequence->Id();
  recording.config.voxel_size_m = sequence->info().voxel_size_m.value_or(0.1);
  if (sequence->info().max_range_m > 0) recording.config.max_range_m = sequence->info().max_range_m;
  recording.config.max_distance_m = max_distance_m;
  for (uint64_t k = 0; k < std::min<uint64_t>(count, sequence->size()); ++k) {
    auto frame = sequence->Read(k);
    if (!frame.ok()) return frame.status();
    frame->source_id = "benchmark";
    frame->max_range_m = recording.config.max_range_m;
    recording.frames.push_back(*std::move(frame));
  }
  return recording;
}

double Percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1) + 0.5)];
}

std::string TakeFlag(int* argc, char** argv, const std::string& name, std::string otherwise) {
  const std::string prefix = "--" + name + "=";
  int kept = 1;
  for (int i = 1; i < *argc; ++i) {
    const std::string argument = argv[i];
    if (argument.rfind(prefix, 0) == 0) {
      otherwise = argument.substr(prefix.size());
    } else {
      argv[kept++] = argv[i];
    }
  }
  *argc = kept;
  return otherwise;
}

uint64_t ResidentBytes(int pid) {
  std::ifstream status("/proc/" + std::to_string(pid) + "/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmRSS:", 0) == 0) return std::stoull(line.substr(6)) * 1024;
  }
  return 0;
}

Frame CanyonFrame(uint64_t index, double end_m) {
  constexpr double kHalfWidth = 12, kEyeHeight = 1.6, kScale = 0.002;
  constexpr uint32_t kWidth = 1280, kHeight = 720;
  DepthImage image;
  image.width = kWidth;
  image.height = kHeight;
  image.fx = image.fy = 640;
  image.cx = 0.5 * (kWidth - 1);
  image.cy = 0.5 * (kHeight - 1);
  image.depth_scale_m = kScale;
  image.depth.resize(size_t{kWidth} * kHeight);
  const double travelled_m = 0.5 * static_cast<double>(index);
  for (uint32_t v = 0; v < kHeight; ++v) {
    const double down = (v - image.cy) / image.fy;
    for (uint32_t u = 0; u < kWidth; ++u) {
      const double right = (u - image.cx) / image.fx;
      double z = end_m - travelled_m;
      if (down > 0) z = std::min(z, kEyeHeight / down);
      if (right != 0) z = std::min(z, kHalfWidth / std::abs(right));
      const double units = std::round(z / kScale);
      image.depth[size_t{v} * kWidth + u] = units < 65536 ? static_cast<uint16_t>(units) : 0;
    }
  }
  Frame frame;
  frame.frame_id = index;
  frame.stamp_ns = static_cast<int64_t>(index) * 100'000'000;
  frame.source_id = "benchmark";
  // Camera: x right, y down, z forward; the street runs along x.
  frame.T_W_X.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  frame.T_W_X.translation() << travelled_m, 0, kEyeHeight;
  frame.observation = std::move(image);
  return frame;
}

}  // namespace clearance::bench
