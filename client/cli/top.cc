// top: a live table of the server; drain: take it out of service.
#include <unistd.h>

#include <iostream>
#include <map>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/context.h"
#include "client/cli/print.h"
#include "client/cli/rates.h"

namespace clearance::cli {
namespace {

struct TopArguments {
  double interval_s = 1.0;
  int count = 0;  // 0 = until interrupted
};

Json ToJson(const client::Latency& latency) {
  return {{"name", latency.name},     {"count", latency.count},   {"mean_ms", latency.mean_ms},
          {"p50_ms", latency.p50_ms}, {"p95_ms", latency.p95_ms}, {"p99_ms", latency.p99_ms},
          {"max_ms", latency.max_ms}};
}

Json ToJson(const client::ServerStats& stats, const Rates& rates) {
  Json json = {{"uptime_s", stats.uptime_s}, {"resident_bytes", stats.resident_bytes},
               {"threads", stats.threads},   {"open_streams", stats.open_streams},
               {"maps", Json::array()},      {"calls", Json::array()}};
  for (const client::MapStats& map : stats.maps) {
    Json entry = {{"map", map.map},
                  {"stamp", cli::ToJson(map.stamp)},
                  {"frames_per_s", rates.Of("map " + map.map)},
                  {"frames_integrated", map.frames_integrated},
                  {"frames_dropped", map.frames_dropped},
                  {"frames_rejected", map.frames_rejected},
                  {"frames_duplicate", map.frames_duplicate},
                  {"queue_length", map.queue_length},
                  {"queue_capacity", map.queue_capacity},
                  {"memory_bytes", map.memory_bytes},
                  {"tracked_objects", map.tracked_objects},
                  {"coasting_objects", map.coasting_objects},
                  {"lost_objects", map.lost_objects},
                  {"retired_objects", map.retired_objects},
                  {"stages", Json::array()}};
    for (const client::Latency& stage : map.stages) entry["stages"].push_back(ToJson(stage));
    json["maps"].push_back(std::move(entry));
  }
  for (const client::Latency& call : stats.calls) {
    Json entry = ToJson(call);
    entry["per_s"] = rates.Of("call " + call.name);
    json["calls"].push_back(std::move(entry));
  }
  return json;
}

std::string Text(const Context& context, const client::ServerStats& stats, const Rates& rates) {
  std::string text =
      absl::StrFormat("%s  up %s  memory %s  threads %d  streams %d\n\n", context.server,
                      absl::FormatDuration(absl::Seconds(static_cast<int64_t>(stats.uptime_s))),
                      Bytes(stats.resident_bytes), stats.threads, stats.open_streams);
  Table maps({"map", "revision", "field lag", "stale s", "frames/s", "queue", "dropped", "rejected",
              "total p50 ms", "p95 ms", "objects", "memory"});
  for (const client::MapStats& map : stats.maps) {
    const client::Latency* total = nullptr;
    for (const client::Latency& stage : map.stages) {
      if (stage.name == "total") total = &stage;
    }
    maps.Add({map.map, std::to_string(map.stamp.revision),
              std::to_string(map.stamp.revision - map.stamp.field_revision),
              Number(map.stamp.staleness_s, 1), Number(rates.Of("map " + map.map), 1),
              absl::StrFormat("%d/%d", map.queue_length, map.queue_capacity),
              std::to_string(map.frames_dropped), std::to_string(map.frames_rejected),
              total ? Number(total->p50_ms, 1) : "-", total ? Number(total->p95_ms, 1) : "-",
              std::to_string(map.tracked_objects + map.coasting_objects), Bytes(map.memory_bytes)});
  }
  text += maps.Text();
  if (stats.calls.empty()) return text;
  Table calls({"call", "per s", "p50 ms", "p95 ms", "p99 ms", "max ms", "count"});
  for (const client::Latency& call : stats.calls) {
    calls.Add({call.name, Number(rates.Of("call " + call.name), 1), Number(call.p50_ms, 2),
               Number(call.p95_ms, 2), Number(call.p99_ms, 2), Number(call.max_ms, 1),
               std::to_string(call.count)});
  }
  return text + "\n" + calls.Text();
}

absl::Status Top(const Context& context, const TopArguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const bool live = isatty(STDOUT_FILENO) && !context.json && arguments.count != 1;
  Rates rates;
  for (int i = 0; arguments.count == 0 || i < arguments.count; ++i) {
    if (i > 0) absl::SleepFor(absl::Seconds(arguments.interval_s));
    const auto stats = (*client)->GetStats(context.map);
    if (!stats.ok()) return stats.status();
    rates.Take(*stats);
    if (context.json) {
      PrintJson(ToJson(*stats, rates));
      continue;
    }
    if (live) std::cout << "\x1b[H\x1b[2J";
    std::cout << Text(context, *stats, rates) << (live ? "\nCtrl-C ends.\n" : "\n") << std::flush;
  }
  return absl::OkStatus();
}

absl::Status Drain(const Context& context, double wait_s) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto settled = (*client)->Drain(wait_s);
  if (!settled.ok()) return settled.status();
  if (context.json) {
    PrintJson({{"settled_frames", *settled}});
  } else {
    std::cout << "drained; " << *settled
              << " frames settled meanwhile. Stop the server when ready.\n";
  }
  return absl::OkStatus();
}

}  // namespace

void AddTop(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<TopArguments>();
  CLI::App* command = AddCommand(app, context, "top", "a live table: maps, rates, latencies",
                                 [&context, arguments] { return Top(context, *arguments); });
  command->add_option("--interval", arguments->interval_s, "seconds between two looks")
      ->check(CLI::Range(0.05, 3600.0))
      ->capture_default_str();
  command->add_option("--count", arguments->count, "looks to take; 0: until interrupted")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
}

void AddDrain(CLI::App& app, Context& context) {
  auto wait_s = std::make_shared<double>(0);
  CLI::App* command =
      AddCommand(app, context, "drain", "take the server out of service, losing nothing",
                 [&context, wait_s] { return Drain(context, *wait_s); });
  command->add_option("--wait", *wait_s, "seconds that frames may take to settle; 0: the server's")
      ->check(CLI::NonNegativeNumber);
}

}  // namespace clearance::cli
