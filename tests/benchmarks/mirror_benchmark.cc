// What following a map costs and what asking its mirror costs, on a sequence:
//   mirror_benchmark SEQUENCE [RATE_HZ] [MAX_DISTANCE_M]
// A server in this process, over a unix socket, takes the sequence's frames at the rate; a mirror
// follows. Prints, for each ten frames, what was told (poses, surfaces, blocks) and the time from
// publishing to the mirror's view; then look-ups at points along straight edges.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <future>
#include <map>
#include <mutex>
#include <random>
#include <thread>
#include <vector>

#include "client/mirror/mirror.h"
#include "client/sequence/sequence.h"
#include "server/engine/live_map.h"
#include "server/service/server.h"

namespace clearance {
namespace {

using Clock = std::chrono::steady_clock;
constexpr size_t kWindow = 10;

double Percentile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[static_cast<size_t>(share * (values.size() - 1))];
}

// When each revision arrived at the mirror.
struct Arrivals {
  std::mutex mu;
  std::map<uint64_t, Clock::time_point> at;
};

int Fail(const absl::Status& status) {
  std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return 4;
}

// 1,000 edges of 1 m, a point every 2 cm, where the map was seen.
std::vector<Eigen::Matrix3Xd> Edges(const MapView& view) {
  std::vector<Eigen::Vector3d> seen;
  view.field.ForEach([&](const BlockIndex& b, const auto& data, uint8_t) {
    if (data) seen.push_back(BlockOrigin(b, view.field.voxel_size_m()));
  });
  std::mt19937 random(1);
  std::normal_distribution<double> direction;
  std::vector<Eigen::Matrix3Xd> edges;
  for (int e = 0; e < 1000; ++e) {
    const Eigen::Vector3d from = seen[random() % seen.size()];
    const Eigen::Vector3d along =
        Eigen::Vector3d(direction(random), direction(random), 0.2 * direction(random)).normalized();
    Eigen::Matrix3Xd& points = edges.emplace_back(3, 50);
    for (int i = 0; i < 50; ++i) points.col(i) = from + 0.02 * i * along;
  }
  return edges;
}

void MeasureLookups(const client::Mirror& mirror) {
  const std::shared_ptr<const MapView> view = mirror.View();
  size_t live = 0;
  for (const ObjectView& object : view->objects) live += object.life_state != LifeState::kRetired;
  const std::vector<Eigen::Matrix3Xd> edges = Edges(*view);
  // As planners ask: several edges in one call.
  constexpr size_t kEdgesPerCall = 20;
  std::vector<double> ns;
  for (int round = 0; round < 5; ++round) {
    for (size_t first = 0; first < edges.size(); first += kEdgesPerCall) {
      Eigen::Matrix3Xd points(3, kEdgesPerCall * edges[0].cols());
      for (size_t e = 0; e < kEdgesPerCall; ++e) {
        points.middleCols(e * edges[0].cols(), edges[0].cols()) = edges[first + e];
      }
      const auto started = Clock::now();
      const auto answers = mirror.Distances(points, 0.5);
      const std::chrono::duration<double, std::nano> taken = Clock::now() - started;
      if (answers.ok()) ns.push_back(taken.count() / static_cast<double>(points.cols()));
    }
  }
  std::printf(
      "look-up with gradient, %zu objects that count, 0.5 s ahead, one thread: median %.0f "
      "ns, p95 %.0f ns a point\n",
      live, Percentile(ns, 0.5), Percentile(ns, 0.95));
}

void PrintWindow(size_t first, size_t last, double seconds, const client::MirrorStatus& before,
                 const client::MirrorStatus& now, const std::vector<double>& lags_ms) {
  const auto rate = [&](uint64_t a, uint64_t b) { return static_cast<double>(b - a) / seconds; };
  const double surfaces = rate(before.surface_bytes, now.surface_bytes);
  std::printf("%3zu-%-3zu %10.0f %10.0f %10.0f %10.0f %9.0f %8.1f %8.1f\n", first, last,
              rate(before.bytes, now.bytes), rate(before.object_bytes, now.object_bytes) - surfaces,
              surfaces, rate(before.block_bytes, now.block_bytes), rate(before.blocks, now.blocks),
              Percentile(lags_ms, 0.5), Percentile(lags_ms, 1));
}

int Run(const std::string& folder, double rate_hz, double max_distance_m) {
  const auto sequence = client::Sequence::Open(folder);
  if (!sequence.ok()) return Fail(sequence.status());
  MapConfig config;
  config.voxel_size_m = sequence->info().voxel_size_m.value_or(0.1);
  config.max_range_m = sequence->info().max_range_m > 0 ? sequence->info().max_range_m : 25;
  config.max_distance_m = max_distance_m;
  RegistryOptions registry_options;
  registry_options.model = LiveMapFactory();
  MapRegistry registry(std::move(registry_options));
  const auto engine = registry.Create("default", config);
  if (!engine.ok()) return Fail(engine.status());
  ServerOptions server_options;
  server_options.socket = std::filesystem::temp_directory_path() /
                          ("mirror_benchmark_" + std::to_string(getpid()) + ".sock");
  const auto server = ClearanceServer::Start(&registry, server_options);
  if (!server.ok()) return Fail(server.status());

  Arrivals arrivals;
  client::MirrorOptions options;
  options.client.address = server_options.socket;
  options.on_update = [&arrivals](const client::MirrorUpdate& update) {
    const auto now = Clock::now();
    std::lock_guard lock(arrivals.mu);
    arrivals.at.emplace(update.stamp.revision, now);
  };
  const auto mirror = client::Mirror::Start(options);
  if (!mirror.ok()) return Fail(mirror.status());
  if (absl::Status s = (*mirror)->WaitUntilReady(absl::Seconds(30)); !s.ok()) return Fail(s);

  std::printf(
      "%s, %zu frames at %g Hz, field to %g m; a second, in bytes:\n%-7s %10s %10s %10s "
      "%10s %9s %8s %8s\n",
      sequence->Id().c_str(), static_cast<size_t>(sequence->size()), rate_hz, max_distance_m,
      "frames", "all", "poses", "surfaces", "blocks", "blocks n", "lag p50", "lag max");
  client::MirrorStatus before = (*mirror)->Status();
  auto next = Clock::now();
  std::vector<double> all_lags, window;
  std::map<uint64_t, Clock::time_point> published;
  for (uint64_t k = 0; k < sequence->size(); ++k) {
    auto frame = sequence->Read(k);
    if (!frame.ok()) return Fail(frame.status());
    frame->source_id = "benchmark";
    frame->max_range_m = config.max_range_m;
    std::this_thread::sleep_until(next);
    next = std::max(Clock::now(),
                    next + std::chrono::microseconds(static_cast<int64_t>(1e6 / rate_hz)));
    std::promise<RevisionStamp> settled;
    (*engine)->Submit(*std::move(frame),
                      [&](const FrameAck& ack) { settled.set_value(ack.stamp); });
    const RevisionStamp stamp = settled.get_future().get();
    published.emplace(stamp.revision, stamp.published_at);
    if (k % kWindow != kWindow - 1) continue;
    if (absl::Status s = (*mirror)->WaitForRevision(stamp.revision, absl::Seconds(30)); !s.ok()) {
      return Fail(s);
    }
    const client::MirrorStatus now = (*mirror)->Status();
    {
      // A revision that was coalesced into a later one counts from when it was published.
      std::lock_guard lock(arrivals.mu);
      for (const auto& [revision, at] : published) {
        const auto arrived = arrivals.at.lower_bound(revision);
        if (arrived == arrivals.at.end()) continue;
        window.push_back(std::chrono::duration<double, std::milli>(arrived->second - at).count());
      }
    }
    published.clear();
    // At the nominal rate, however long the machine took.
    PrintWindow(k + 1 - kWindow, k, kWindow / rate_hz, before, now, window);
    all_lags.insert(all_lags.end(), window.begin(), window.end());
    window.clear();
    before = now;
  }
  std::printf("lag of publish to mirror: median %.1f ms, p99 %.1f ms\n", Percentile(all_lags, 0.5),
              Percentile(all_lags, 0.99));
  MeasureLookups(**mirror);
  return 0;
}

}  // namespace
}  // namespace clearance

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s SEQUENCE [RATE_HZ] [MAX_DISTANCE_M]\n", argv[0]);
    return 2;
  }
  return clearance::Run(argv[1], argc > 2 ? std::atof(argv[2]) : 10,
                        argc > 3 ? std::atof(argv[3]) : 5);
}
