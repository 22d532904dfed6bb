// bench watch: many followers of one map at once, and how late they hear.
#include "client/cli/bench_watch.h"

#include <iostream>
#include <thread>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/connect.h"
#include "client/cli/latencies.h"
#include "client/cli/print.h"
#include "client/watch.h"

namespace clearance::cli {
namespace {

struct Arguments {
  int clients = 1;
  double seconds = 5;
  double max_rate_hz = 0;
  bool poses_only = false;
};

struct Follower {
  Latencies lags;  // of deltas: from the frame's publication to when it was told
  uint64_t checkpoints = 0, deltas = 0, revisions = 0;
  uint64_t checkpoint_bytes = 0, delta_bytes = 0;
  absl::Status status;

  void Hear(const client::WatchEvent& event) {
    if (event.checkpoint) {
      ++checkpoints;
      checkpoint_bytes += event.bytes;
      return;
    }
    ++deltas;
    delta_bytes += event.bytes;
    revisions += event.stamp.revision - event.prev_revision;
    lags.Add(event.stamp.staleness_s * 1e3);
  }
};

absl::Status RunWatchBench(const Context& context, const Arguments& arguments) {
  const absl::StatusOr<client::ClientOptions> client = ClientOptionsOf(context);
  if (!client.ok()) return client.status();
  client::WatchOptions options;
  options.max_rate_hz = arguments.max_rate_hz;
  options.poses_only = arguments.poses_only;
  const absl::Time start = absl::Now();
  options.until = start + absl::Seconds(arguments.seconds);

  std::vector<Follower> followers(static_cast<size_t>(arguments.clients));
  std::vector<std::thread> threads;
  for (Follower& follower : followers) {
    threads.emplace_back([&] {
      follower.status = client::WatchMap(*client, options, [&](const client::WatchEvent& event) {
        follower.Hear(event);
        return true;
      });
    });
  }
  for (std::thread& thread : threads) thread.join();
  const double seconds = absl::ToDoubleSeconds(absl::Now() - start);
  Follower all;
  for (const Follower& follower : followers) {
    if (!follower.status.ok()) return follower.status;
    all.lags.Merge(follower.lags);
    all.checkpoints += follower.checkpoints;
    all.deltas += follower.deltas;
    all.revisions += follower.revisions;
    all.checkpoint_bytes += follower.checkpoint_bytes;
    all.delta_bytes += follower.delta_bytes;
  }
  const auto bytes = static_cast<double>(all.checkpoint_bytes + all.delta_bytes);
  if (context.json) {
    PrintJson({{"map", context.MapName()},
               {"clients", arguments.clients},
               {"seconds", seconds},
               {"checkpoints", all.checkpoints},
               {"checkpoint_bytes", all.checkpoint_bytes},
               {"deltas", all.deltas},
               {"delta_bytes", all.delta_bytes},
               {"revisions", all.revisions},
               {"bytes_per_s", bytes / seconds},
               {"lag", all.lags.ToJson()}});
    return absl::OkStatus();
  }
  std::cout << absl::StrFormat(
                   "map %s: %d clients in %.1f s heard %d checkpoints and %d deltas of %d "
                   "revisions, %.2f MB/s in all\n",
                   context.MapName(), arguments.clients, seconds, all.checkpoints, all.deltas,
                   all.revisions, bytes / seconds / 1e6)
            << "from a frame's publication to its delta\n"
            << all.lags.Text();
  return absl::OkStatus();
}

}  // namespace

void AddBenchWatch(CLI::App& bench, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* watch =
      AddCommand(bench, context, "watch", "several followers of a map that others stream into",
                 [&context, arguments] { return RunWatchBench(context, *arguments); });
  watch->add_option("--clients", arguments->clients, "each with a connection and a thread")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  watch->add_option("--seconds", arguments->seconds, "how long")
      ->check(CLI::Range(0.01, 86400.0))
      ->capture_default_str();
  watch->add_option("--max-rate", arguments->max_rate_hz, "deltas a second and client at most")
      ->check(CLI::NonNegativeNumber);
  watch->add_flag("--poses-only", arguments->poses_only, "objects alone, no blocks");
}

}  // namespace clearance::cli
