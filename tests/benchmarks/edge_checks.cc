// What a sampling planner pays for its edges: edge_checks SEQUENCE [FRAMES] [MAX_DISTANCE_M].
// 10,000 edges of 1 m, one ball of 0.5 m, on the map of the sequence with its objects moving, by
// three roads: in this process, by CheckTrajectories in batches of 100 over a unix socket, and by
// one unary QueryPoints for each state, 5 cm apart (a part of the edges, scaled).
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "client/esdf_client.h"
#include "client/sequence/sequence.h"
#include "server/engine/live_map.h"
#include "server/query/trajectory_check.h"
#include "server/service/server.h"

namespace clearance {
namespace {

constexpr int kEdges = 10'000, kBatch = 100, kUnaryEdges = 100, kStatesAnEdge = 20;
constexpr double kLength_m = 1, kRadius_m = 0.5, kSpeed_mps = 5;
constexpr int kRuns = 5;

// Wall and processor time (all threads of this process) of one run, milliseconds.
struct Cost {
  double wall_ms = 0, cpu_ms = 0;
};

template <typename Work>
Cost Measure(Work work) {
  std::vector<Cost> runs;
  for (int i = 0; i < kRuns; ++i) {
    const auto wall = std::chrono::steady_clock::now();
    const std::clock_t cpu = std::clock();
    work();
    runs.push_back(
        {std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - wall).count(),
         1e3 * static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC});
  }
  std::sort(runs.begin(), runs.end(), [](auto& a, auto& b) { return a.wall_ms < b.wall_ms; });
  Cost median = runs[kRuns / 2];
  std::sort(runs.begin(), runs.end(), [](auto& a, auto& b) { return a.cpu_ms < b.cpu_ms; });
  median.cpu_ms = runs[kRuns / 2].cpu_ms;
  return median;
}

[[noreturn]] void Die(const absl::Status& status) {
  std::fprintf(stderr, "%s\n", status.ToString().c_str());
  std::exit(4);
}

// As a tree grows: from states that are free, at 0.8 m height, in directions at random.
std::vector<RobotPath> MakeEdges(const MapView& view, const CheckOptions& options) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> unit(0, 1);
  const std::vector<RobotSphere> robot = {{Eigen::Vector3d::Zero(), kRadius_m}};
  std::vector<RobotPath> edges;
  const Eigen::Vector3d centre_W =
      view.sensor_path && !view.sensor_path->empty()
          ? Eigen::Vector3d(view.sensor_path->back().pose.translation())
          : Eigen::Vector3d(Eigen::Vector3d::Zero());
  for (int tries = 0; static_cast<int>(edges.size()) < kEdges && tries < 1000 * kEdges; ++tries) {
    RobotPath edge;
    edge.T_W_R.assign(2, Pose::Identity());
    edge.T_W_R[0].translation() << centre_W.x() + 50 * (unit(rng) - 0.5),
        centre_W.y() + 50 * (unit(rng) - 0.5), 0.8;
    const double heading = 2 * M_PI * unit(rng);
    edge.T_W_R[1].translation() =
        edge.T_W_R[0].translation() +
        kLength_m * Eigen::Vector3d(std::cos(heading), std::sin(heading), 0);
    const double start_s = 3 * unit(rng);
    edge.horizons_s = {start_s, start_s + kLength_m / kSpeed_mps};
    const RobotPath start{{edge.T_W_R[0]}, {start_s}};
    if (!CheckPaths(view, robot, {start}, options)[0].collides) edges.push_back(edge);
  }
  return edges;
}

void Report(const char* road, const Cost& cost, const Cost& against) {
  std::printf("  %-46s %9.1f %9.1f %9.1f\n", road, cost.wall_ms, cost.cpu_ms,
              against.wall_ms / cost.wall_ms);
}

void RunPolicy(const MapView& view, const client::EsdfClient& client, bool unknown_as_free) {
  CheckOptions options;
  options.unknown_as_occupied = !unknown_as_free;
  const std::vector<RobotSphere> robot = {{Eigen::Vector3d::Zero(), kRadius_m}};
  const std::vector<RobotPath> edges = MakeEdges(view, options);
  if (edges.size() < kEdges) {
    std::printf("unknown as %s: only %zu free starts found\n",
                unknown_as_free ? "free" : "occupied", edges.size());
    return;
  }
  size_t collide = 0;
  for (const PathCheck& check : CheckPaths(view, robot, edges, options)) collide += check.collides;

  const Cost all = Measure([&] { CheckPaths(view, robot, edges, options); });
  const Cost batches = Measure([&] {
    for (int i = 0; i < kEdges; i += kBatch) {
      CheckPaths(view, robot, {edges.begin() + i, edges.begin() + i + kBatch}, options);
    }
  });
  const Cost one_core = Measure([&] {
    for (int i = 0; i < kEdges; i += kBatch / 2) {  // too few for several threads
      CheckPaths(view, robot, {edges.begin() + i, edges.begin() + i + kBatch / 2}, options);
    }
  });

  client::CheckOptions asked;
  asked.unknown_as_free = unknown_as_free;
  const std::vector<client::Sphere> ball = {
      {Eigen::Vector3f::Zero(), static_cast<float>(kRadius_m)}};
  std::vector<std::vector<client::Trajectory>> requests;
  for (int i = 0; i < kEdges; i += kBatch) {
    requests.emplace_back();
    for (int k = i; k < i + kBatch; ++k) {
      requests.back().push_back({edges[k].T_W_R, edges[k].horizons_s});
    }
  }
  size_t remote_collide = 0;
  const Cost remote = Measure([&] {
    remote_collide = 0;
    for (const auto& request : requests) {
      const auto answers = client.CheckTrajectories(ball, request, asked);
      if (!answers.ok()) Die(answers.status());
      for (const auto& result : answers->results) remote_collide += result.collides;
    }
  });
  Cost unary = Measure([&] {
    for (int i = 0; i < kUnaryEdges; ++i) {
      for (int k = 0; k < kStatesAnEdge; ++k) {
        const double share = (k + 1.0) / kStatesAnEdge;
        client::QueryOptions query;
        query.unknown_distances = !unknown_as_free;
        query.horizon_s =
            edges[i].horizons_s[0] + share * (edges[i].horizons_s[1] - edges[i].horizons_s[0]);
        const Eigen::Vector3d p_W =
            (1 - share) * edges[i].T_W_R[0].translation() + share * edges[i].T_W_R[1].translation();
        const auto answers = client.QueryPoints(p_W, query);
        if (!answers.ok()) Die(answers.status());
      }
    }
  });
  unary.wall_ms *= double{kEdges} / kUnaryEdges;
  unary.cpu_ms *= double{kEdges} / kUnaryEdges;

  std::printf("unknown space as %s: %.1f %% of the edges collide%s\n",
              unknown_as_free ? "free" : "occupied", 100.0 * collide / kEdges,
              remote_collide == collide ? "" : " (the server says otherwise!)");
  std::printf("  %-46s %9s %9s %9s\n", "10,000 edges of 1 m, median of 5", "wall ms", "cpu ms",
              "ratio");
  Report("in process, one call", all, unary);
  Report("in process, batches of 100", batches, unary);
  Report("in process, one thread", one_core, unary);
  Report("CheckTrajectories, batches of 100", remote, unary);
  Report("one unary RPC a state (from 100 edges)", unary, unary);
}

int Main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s SEQUENCE [FRAMES] [MAX_DISTANCE_M]\n", argv[0]);
    return 2;
  }
  const auto sequence = client::Sequence::Open(argv[1]);
  if (!sequence.ok()) Die(sequence.status());
  MapConfig config;
  config.voxel_size_m = sequence->info().voxel_size_m.value_or(0.1);
  config.max_range_m = sequence->info().max_range_m > 0 ? sequence->info().max_range_m : 25;
  const uint64_t frames =
      std::min<uint64_t>(sequence->size(), argc > 2 ? std::atoi(argv[2]) : sequence->size());
  config.max_distance_m = argc > 3 ? std::atof(argv[3]) : 5.0;

  RegistryOptions registry_options;
  registry_options.model = LiveMapFactory();
  MapRegistry registry(registry_options);
  const auto engine = registry.Create("default", config);
  if (!engine.ok()) Die(engine.status());
  for (uint64_t k = 0; k < frames; ++k) {
    auto frame = sequence->Read(k);
    if (!frame.ok()) Die(frame.status());
    frame->source_id = "benchmark";
    frame->max_range_m = config.max_range_m;
    while ((*engine)->Submit(std::move(*frame), [](const FrameAck&) {}) == Admission::kFull) {
      usleep(1000);
    }
  }
  while ((*engine)->Latest()->revision < frames) usleep(1000);
  const ViewPtr view = (*engine)->Latest();
  size_t objects = 0;
  for (const ObjectView& object : view->objects)
    objects += object.life_state != LifeState::kRetired;

  ServerOptions options;
  const std::filesystem::path folder =
      std::filesystem::temp_directory_path() / ("edge_checks_" + std::to_string(getpid()));
  std::filesystem::create_directory(folder);
  options.socket = (folder / "socket").string();
  auto server = ClearanceServer::Start(&registry, options);
  if (!server.ok()) Die(server.status());
  client::ClientOptions client_options;
  client_options.address = options.socket;
  const auto client = client::EsdfClient::Connect(client_options);
  if (!client.ok()) Die(client.status());
  std::printf("%s, %lu frames, %g m voxels, field to %g m, %zu live objects\n",
              sequence->Id().c_str(), static_cast<unsigned long>(frames), config.voxel_size_m,
              config.max_distance_m, objects);
  for (const bool unknown_as_free : {false, true}) RunPolicy(*view, **client, unknown_as_free);
  (*server)->Drain();
  std::filesystem::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace clearance

int main(int argc, char** argv) { return clearance::Main(argc, argv); }
