// bench: load on a server of one's own, and how long it takes to answer.
#include "client/cli/bench.h"

#include <iostream>
#include <map>
#include <random>
#include <thread>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/bench_watch.h"
#include "client/cli/latencies.h"
#include "client/cli/print.h"
#include "client/sequence/sequence.h"

namespace clearance::cli {
namespace {

struct QueryArguments {
  int points = 1000;
  int clients = 1;
  double seconds = 5;
  double rate_hz = 0;
  bool edges = false;
  bool no_gradients = false;
  std::vector<double> bounds;
};

constexpr int kEdgePoints = 100;
constexpr double kEdgeStep_m = 0.05;

// Where to ask: the box that was given, or what the map has observed.
absl::StatusOr<Aabb> Bounds(const client::EsdfClient& client, const QueryArguments& arguments) {
  if (!arguments.bounds.empty()) {
    const std::vector<double>& b = arguments.bounds;
    const Aabb box(Eigen::Vector3d(b[0], b[1], b[2]), Eigen::Vector3d(b[3], b[4], b[5]));
    if (box.isEmpty()) return absl::InvalidArgumentError("--bounds: expected low before high");
    return box;
  }
  const auto info = client.GetMap();
  if (!info.ok()) return info.status();
  if (!info->observed_bounds) {
    return absl::FailedPreconditionError(
        "the map has observed nothing yet: ingest first, or say --bounds");
  }
  return *info->observed_bounds;
}

// Random points, or straight edges of a hundred points such as a planner checks.
Eigen::Matrix3Xd MakePoints(const Aabb& box, const QueryArguments& arguments, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto any = [&] {
    const Eigen::Vector3d share(unit(random), unit(random), unit(random));
    return Eigen::Vector3d(box.min() + share.cwiseProduct(box.sizes()));
  };
  Eigen::Matrix3Xd points(3, arguments.points);
  Eigen::Vector3d from = any(), step = Eigen::Vector3d::Zero();
  for (int i = 0; i < arguments.points; ++i) {
    if (!arguments.edges) {
      points.col(i) = any();
      continue;
    }
    if (i % kEdgePoints == 0) {
      from = any();
      step = (any() - from).normalized() * kEdgeStep_m;
    }
    points.col(i) = from + step * (i % kEdgePoints);
  }
  return points;
}

absl::Status RunQueries(const Context& context, const QueryArguments& arguments) {
  const auto first = context.Connect();
  if (!first.ok()) return first.status();
  const auto box = Bounds(**first, arguments);
  if (!box.ok()) return box.status();
  client::QueryOptions options;
  options.gradients = !arguments.no_gradients;
  const auto once = (*first)->QueryPoints(MakePoints(*box, arguments, 0), options);
  if (!once.ok()) return once.status();

  struct Caller {
    Latencies latencies;
    absl::Status status;
  };
  std::vector<Caller> callers(static_cast<size_t>(arguments.clients));
  std::vector<std::thread> threads;
  const absl::Time start = absl::Now(), end = start + absl::Seconds(arguments.seconds);
  for (size_t c = 0; c < callers.size(); ++c) {
    threads.emplace_back([&, c] {
      Caller& caller = callers[c];
      const auto client = context.Connect();
      if (!client.ok()) return void(caller.status = client.status());
      const auto points = MakePoints(*box, arguments, static_cast<uint32_t>(c));
      for (uint64_t call = 0;; ++call) {
        // At a rate, a call is late from when it was due: a slow answer does not hide the next one.
        absl::Time due = absl::Now();
        if (arguments.rate_hz > 0) {
          due = start + absl::Seconds(static_cast<double>(call) / arguments.rate_hz);
          absl::SleepFor(due - absl::Now());
        }
        if (due >= end) return;
        const auto answers = (*client)->QueryPoints(points, options);
        if (!answers.ok()) return void(caller.status = answers.status());
        caller.latencies.Add(absl::ToDoubleMilliseconds(absl::Now() - due));
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  const double seconds = absl::ToDoubleSeconds(absl::Now() - start);
  Latencies all;
  for (const Caller& caller : callers) {
    if (!caller.status.ok()) return caller.status;
    all.Merge(caller.latencies);
  }
  const double calls_per_s = static_cast<double>(all.count()) / seconds;
  if (context.json) {
    Json json = {{"map", context.MapName()},     {"points", arguments.points},
                 {"clients", arguments.clients}, {"gradients", options.gradients},
                 {"edges", arguments.edges},     {"seconds", seconds},
                 {"calls_per_s", calls_per_s},   {"points_per_s", calls_per_s * arguments.points},
                 {"latency", all.ToJson()}};
    PrintJson(json);
    return absl::OkStatus();
  }
  std::cout << absl::StrFormat(
                   "map %s: %d calls of %d points from %d clients in %.1f s, %.0f calls/s, "
                   "%.0f points/s\n",
                   context.MapName(), all.count(), arguments.points, arguments.clients, seconds,
                   calls_per_s, calls_per_s * arguments.points)
            << all.Text();
  return absl::OkStatus();
}

struct IngestArguments {
  std::string folder;
  uint64_t frames = 60;
  double max_distance_m = 0;
  bool keep = false;
};

// Times from sending a frame to its acknowledgement.
class SendTimes {
 public:
  void Sent(uint64_t frame_id) {
    const absl::MutexLock lock(&mutex_);
    sent_[frame_id] = absl::Now();
  }
  void Settled(const client::FrameAck& ack) {
    if (ack.status == client::AckStatus::kAccepted) return;
    const absl::MutexLock lock(&mutex_);
    if (ack.status != client::AckStatus::kIntegrated) {
      ++others_;
      return;
    }
    const auto it = sent_.find(ack.frame_id);
    if (it == sent_.end()) return;
    from_sending_.Add(absl::ToDoubleMilliseconds(absl::Now() - it->second));
    integration_.Add(ack.integrate_ms);
  }
  Latencies from_sending() const {
    const absl::MutexLock lock(&mutex_);
    return from_sending_;
  }
  Latencies integration() const {
    const absl::MutexLock lock(&mutex_);
    return integration_;
  }
  uint64_t others() const {
    const absl::MutexLock lock(&mutex_);
    return others_;
  }

 private:
  mutable absl::Mutex mutex_;
  std::map<uint64_t, absl::Time> sent_ ABSL_GUARDED_BY(mutex_);
  Latencies from_sending_ ABSL_GUARDED_BY(mutex_), integration_ ABSL_GUARDED_BY(mutex_);
  uint64_t others_ ABSL_GUARDED_BY(mutex_) = 0;  // dropped, rejected, duplicate
};

// Frames as fast as they are acknowledged, decoded beforehand. Seconds from the first to the last.
absl::StatusOr<double> StreamAll(const client::EsdfClient& client, const std::string& map,
                                 const std::vector<Frame>& frames, double max_range_m,
                                 SendTimes* times) {
  client::IngestOptions options;
  options.map = map;
  options.source_id = "bench";
  options.max_range_m = max_range_m;
  options.on_ack = [times](const client::FrameAck& ack) { times->Settled(ack); };
  auto stream = client.OpenIngest(options);
  if (!stream.ok()) return stream.status();
  const absl::Time start = absl::Now();
  for (const Frame& frame : frames) {
    times->Sent(frame.frame_id);
    if (absl::Status s = (*stream)->Send(frame); !s.ok()) return s;
  }
  if (absl::Status s = (*stream)->Finish(); !s.ok()) return s;
  return absl::ToDoubleSeconds(absl::Now() - start);
}

absl::Status RunIngestBench(const Context& context, const IngestArguments& arguments) {
  const auto sequence = client::Sequence::Open(arguments.folder);
  if (!sequence.ok()) return sequence.status();
  std::vector<Frame> frames;
  for (uint64_t k = 0; k < std::min<uint64_t>(arguments.frames, sequence->size()); ++k) {
    auto frame = sequence->Read(k);
    if (!frame.ok()) return frame.status();
    frames.push_back(*std::move(frame));
  }
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  // A map of its own, so that nobody's is touched.
  const std::string map = context.map.empty()
                              ? absl::StrFormat("bench-%d", absl::ToUnixMillis(absl::Now()))
                              : context.map;
  wire::MapSettings settings;
  settings.voxel_size_m = sequence->info().voxel_size_m;
  if (sequence->info().max_range_m > 0) settings.max_range_m = sequence->info().max_range_m;
  if (arguments.max_distance_m > 0) settings.max_distance_m = arguments.max_distance_m;
  const auto created = (*client)->CreateMap(map, settings);
  if (!created.ok()) return created.status();
  SendTimes times;
  const absl::StatusOr<double> seconds =
      StreamAll(**client, map, frames, sequence->info().max_range_m, &times);
  if (!arguments.keep) {
    if (absl::Status s = (*client)->DeleteMap(map); !s.ok() && seconds.ok()) return s;
  }
  if (!seconds.ok()) return seconds.status();
  const double frames_per_s = static_cast<double>(times.from_sending().count()) / *seconds;
  if (context.json) {
    PrintJson({{"map", map},
               {"kept", arguments.keep},
               {"frames", frames.size()},
               {"not_integrated", times.others()},
               {"seconds", *seconds},
               {"frames_per_s", frames_per_s},
               {"sent_to_integrated", times.from_sending().ToJson()},
               {"integration", times.integration().ToJson()}});
    return absl::OkStatus();
  }
  std::cout << absl::StrFormat("%d frames in %.2f s, %.1f frames/s; %d not integrated\n",
                               frames.size(), *seconds, frames_per_s, times.others())
            << "integration on the server\n"
            << times.integration().Text() << "sent to integrated\n"
            << times.from_sending().Text();
  return absl::OkStatus();
}

}  // namespace

void AddBench(CLI::App& app, Context& context) {
  CLI::App* bench =
      app.add_subcommand("bench", "load on a server, and how long it takes to answer");
  bench->require_subcommand(1);

  auto query = std::make_shared<QueryArguments>();
  CLI::App* queries =
      AddCommand(*bench, context, "query", "QueryPoints from several clients at once",
                 [&context, query] { return RunQueries(context, *query); });
  queries->add_option("--points", query->points, "of one call")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  queries->add_option("--clients", query->clients, "each with a connection and a thread")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  queries->add_option("--seconds", query->seconds, "how long")
      ->check(CLI::Range(0.01, 86400.0))
      ->capture_default_str();
  queries->add_option("--rate", query->rate_hz, "calls a second and client (default: no pause)")
      ->check(CLI::PositiveNumber);
  queries->add_flag("--edges", query->edges,
                    "straight edges of 100 points, 5 cm apart, instead of random points");
  queries->add_flag("--no-gradients", query->no_gradients, "distances and states only");
  queries
      ->add_option("--bounds", query->bounds,
                   "x y z x y z of the box to ask in (default: what was observed)")
      ->expected(6);

  auto ingest = std::make_shared<IngestArguments>();
  CLI::App* frames =
      AddCommand(*bench, context, "ingest",
                 "frames of a sequence folder, decoded beforehand, into a new map that goes again",
                 [&context, ingest] { return RunIngestBench(context, *ingest); });
  frames->add_option("folder", ingest->folder, "with sequence.json")->required();
  frames->add_option("--frames", ingest->frames, "only the first so many")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  frames->add_option("--max-distance-m", ingest->max_distance_m, "reach of the field")
      ->check(CLI::PositiveNumber);
  frames->add_flag("--keep", ingest->keep, "leave the map");
  AddBenchWatch(*bench, context);
}

}  // namespace clearance::cli
