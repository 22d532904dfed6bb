// A server as its clients see it: latency of QueryPoints by batch, transport and number of clients,
// at rest and beside ingest; frames a second; the server's memory. run.sh starts the server:
//   rpc_benchmark --tcp=HOST:PORT --socket=PATH --pid=PID --data=FOLDER --frames=20
#include <benchmark/benchmark.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <thread>

#include "client/esdf_client.h"
#include "tests/benchmarks/bench_frames.h"

namespace clearance::bench {
namespace {

using Clock = std::chrono::steady_clock;
using client::EsdfClient;

struct Setup {
  std::string tcp, socket, folder;
  int pid = 0;
  size_t frames = 20;
  Recording street;
};
Setup setup;

void ExitWith(const absl::Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "rpc_benchmark: %s\n", status.ToString().c_str());
  std::exit(1);
}

std::unique_ptr<EsdfClient> Connect(bool unix_socket) {
  client::ClientOptions options;
  options.address = unix_socket ? setup.socket : setup.tcp;
  auto client = EsdfClient::Connect(options);
  ExitWith(client.status());
  return *std::move(client);
}

void CreateMap(const EsdfClient& client, const std::string& map) {
  wire::MapSettings settings;
  settings.voxel_size_m = setup.street.config.voxel_size_m;
  settings.max_range_m = setup.street.config.max_range_m;
  settings.max_distance_m = setup.street.config.max_distance_m;
  ExitWith(client.CreateMap(map, settings).status());
}

struct Streamed {
  double seconds = 0;
  uint64_t largest_lag = 0;  // frames sent before the one that is acknowledged
  std::vector<double> integrate_ms;
};

// Sends all frames as fast as they are acknowledged. `integrated` counts them.
Streamed Stream(const EsdfClient& client, const std::string& map, std::atomic<size_t>* integrated) {
  Streamed streamed;
  std::atomic<size_t> count = 0;
  client::IngestOptions options;
  options.map = map;
  options.source_id = "benchmark";
  options.max_range_m = setup.street.config.max_range_m;
  options.on_ack = [&](const client::FrameAck& ack) {
    if (ack.status != client::AckStatus::kIntegrated) return;
    streamed.integrate_ms.push_back(ack.integrate_ms);
    count.fetch_add(1);
    if (integrated != nullptr) integrated->store(count);
  };
  auto stream = client.OpenIngest(options);
  ExitWith(stream.status());
  const Clock::time_point start = Clock::now();
  for (const Frame& frame : setup.street.frames) ExitWith((*stream)->Send(frame));
  ExitWith((*stream)->Finish());
  streamed.seconds = std::chrono::duration<double>(Clock::now() - start).count();
  if (count != setup.street.frames.size()) {
    ExitWith(absl::InternalError("not every frame was integrated"));
  }
  return streamed;
}

// Points about the path of the camera.
Eigen::Matrix3Xd RandomPoints(int count, uint32_t seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  Eigen::Matrix3Xd points(3, count);
  for (int i = 0; i < count; ++i) {
    const Frame& frame = setup.street.frames[rng() % setup.street.frames.size()];
    points.col(i) =
        frame.T_W_X * Eigen::Vector3d(8 * unit(rng), 1.5 * unit(rng), 10 + 9 * unit(rng));
  }
  return points;
}

Eigen::Matrix3Xd EdgePoints(int edges, int per_edge, uint32_t seed) {
  const Eigen::Matrix3Xd ends = RandomPoints(2 * edges, seed);
  Eigen::Matrix3Xd points(3, edges * per_edge);
  for (int e = 0; e < edges; ++e) {
    const Eigen::Vector3d step = (ends.col(2 * e + 1) - ends.col(2 * e)).normalized() * 0.05;
    for (int i = 0; i < per_edge; ++i) points.col(e * per_edge + i) = ends.col(2 * e) + i * step;
  }
  return points;
}

double QueryMs(const EsdfClient& client, const std::string& map, const Eigen::Matrix3Xd& points) {
  client::QueryOptions options;
  options.map = map;
  options.gradients = true;
  const Clock::time_point start = Clock::now();
  const auto answers = client.QueryPoints(points, options);
  const double ms = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  ExitWith(answers.status());
  return ms;
}

void Report(benchmark::State& state, std::vector<double> ms) {
  state.counters["p50_ms"] = Percentile(ms, 0.5);
  state.counters["p99_ms"] = Percentile(ms, 0.99);
  state.counters["calls"] = static_cast<double>(ms.size());
}

// Arguments: points, unix socket or not, clients.
void AtRest(benchmark::State& state) {
  const auto points = RandomPoints(static_cast<int>(state.range(0)), 1);
  const auto clients = static_cast<size_t>(state.range(2));
  std::vector<std::vector<double>> others(clients - 1);
  std::atomic<bool> stop = false;
  std::vector<std::thread> threads;
  for (auto& ms : others) {
    threads.emplace_back([&] {
      const auto client = Connect(state.range(1) != 0);
      while (!stop) ms.push_back(QueryMs(*client, "street", points));
    });
  }
  const auto client = Connect(state.range(1) != 0);
  QueryMs(*client, "street", points);
  std::vector<double> ms;
  for (auto _ : state) {
    ms.push_back(QueryMs(*client, "street", points));
    state.SetIterationTime(ms.back() * 1e-3);
  }
  stop = true;
  for (std::thread& thread : threads) thread.join();
  for (const auto& more : others) ms.insert(ms.end(), more.begin(), more.end());
  Report(state, std::move(ms));
}

// Streams the recording into one new map after another. Callers ask the newest that has content.
class EndlessIngest {
 public:
  EndlessIngest() : client_(Connect(true)), thread_([this] { Run(); }) {
    while (ready_ < 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ~EndlessIngest() {
    stop_ = true;
    thread_.join();
    for (const int k : {ready_.load(), ready_.load() + 1}) {
      client_->DeleteMap(NameOf(k)).IgnoreError();
    }
  }
  std::string Map() const { return NameOf(ready_); }
  double frames_per_s() const { return static_cast<double>(frames_) / seconds_; }

 private:
  static constexpr size_t kEnoughFrames = 5;
  static std::string NameOf(int k) { return "live-" + std::to_string(k); }

  void Run() {
    for (int k = 0; !stop_; ++k) {
      CreateMap(*client_, NameOf(k));
      std::atomic<size_t> integrated = 0;
      std::atomic<bool> done = false;
      // The map before stays until this one has something to say.
      std::thread watcher([&] {
        while (integrated < kEnoughFrames && !done) {
          std::this_thread::sleep_for(std::chrono::milliseconds(2));
        }
        ready_ = k;
        std::this_thread::sleep_for(std::chrono::milliseconds(200));  // calls that name the old one
        if (k > 0) client_->DeleteMap(NameOf(k - 1)).IgnoreError();
      });
      const Streamed streamed = Stream(*client_, NameOf(k), &integrated);
      done = true;
      watcher.join();
      frames_ += setup.street.frames.size();
      seconds_ = seconds_ + streamed.seconds;
    }
  }

  const std::unique_ptr<EsdfClient> client_;
  std::atomic<bool> stop_ = false;
  std::atomic<int> ready_ = -1;
  std::atomic<size_t> frames_ = 0;
  std::atomic<double> seconds_ = 0;
  std::thread thread_;
};

void Beside(benchmark::State& state, const Eigen::Matrix3Xd& points, int pause_ms) {
  std::vector<double> ms;
  double frames_per_s = 0;
  {
    EndlessIngest ingest;
    const auto client = Connect(false);
    for (auto _ : state) {
      std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
      ms.push_back(QueryMs(*client, ingest.Map(), points));
      state.SetIterationTime((ms.back() + pause_ms) * 1e-3);
    }
    frames_per_s = ingest.frames_per_s();
  }
  Report(state, std::move(ms));
  if (frames_per_s > 0) state.counters["frames_per_s"] = frames_per_s;
}

void BesideIngestRandom(benchmark::State& state) {
  Beside(state, RandomPoints(static_cast<int>(state.range(0)), 2), 10);
}
void BesideIngestEdges(benchmark::State& state) { Beside(state, EdgePoints(100, 100, 3), 10); }
// What the end-to-end rate is measured beside: 1,000 points at 20 Hz.
void BesideIngest20Hz(benchmark::State& state) { Beside(state, RandomPoints(1000, 4), 49); }

// The map that AtRest asks, and what it costs the server.
void IngestAndMemory(benchmark::State& state) {
  const auto client = Connect(true);
  QueryMs(*client, "", Eigen::Matrix3Xd::Zero(3, 1));
  for (auto _ : state) {
    const uint64_t before = ResidentBytes(setup.pid);
    CreateMap(*client, "street");
    const Streamed streamed = Stream(*client, "street", nullptr);
    state.counters["frames_per_s"] =
        static_cast<double>(setup.street.frames.size()) / streamed.seconds;
    state.counters["integrate_p50_ms"] = Percentile(streamed.integrate_ms, 0.5);
    state.counters["server_growth_bytes"] =
        static_cast<double>(ResidentBytes(setup.pid)) - static_cast<double>(before);
    state.SetIterationTime(streamed.seconds);
  }
}

}  // namespace
}  // namespace clearance::bench

int main(int argc, char** argv) {
  using namespace clearance::bench;
  setup.tcp = TakeFlag(&argc, argv, "tcp", "");
  setup.socket = TakeFlag(&argc, argv, "socket", "");
  setup.folder = TakeFlag(&argc, argv, "data", ".") + "/street";
  setup.pid = std::stoi(TakeFlag(&argc, argv, "pid", "0"));
  setup.frames = std::stoul(TakeFlag(&argc, argv, "frames", "20"));
  const bool quick = TakeFlag(&argc, argv, "quick", "0") == "1";
  auto street = LoadRecording(setup.folder, setup.frames, 2);
  ExitWith(street.status());
  setup.street = *std::move(street);

  benchmark::RegisterBenchmark("IngestAndMemory", IngestAndMemory)
      ->Iterations(1)
      ->UseManualTime()
      ->Unit(benchmark::kMillisecond);
  const std::vector<int64_t> batches = quick
                                           ? std::vector<int64_t>{1, 1000, 10000}
                                           : std::vector<int64_t>{1, 10, 100, 1000, 10000, 100000};
  benchmark::RegisterBenchmark("AtRest", AtRest)
      ->ArgNames({"points", "unix", "clients"})
      ->ArgsProduct({batches, {0, 1}, quick ? std::vector<int64_t>{1} : std::vector<int64_t>{1, 4}})
      ->UseManualTime()
      ->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("BesideIngestRandom", BesideIngestRandom)
      ->ArgNames({"points"})
      ->ArgsProduct(
          {quick ? std::vector<int64_t>{10000} : std::vector<int64_t>{1000, 10000, 100000}})
      ->Iterations(quick ? 60 : 300)
      ->UseManualTime()
      ->Unit(benchmark::kMillisecond);
  for (const auto& [name, run] : {std::pair{"BesideIngestEdges", BesideIngestEdges},
                                  std::pair{"BesideIngest20Hz", BesideIngest20Hz}}) {
    benchmark::RegisterBenchmark(name, run)
        ->Iterations(quick ? 60 : 300)
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
