// watch: what a map tells those who follow it, a line for each delta.
#include "client/cli/watch.h"

#include <iostream>

#include "absl/strings/str_format.h"
#include "client/cli/connect.h"
#include "client/cli/print.h"
#include "client/watch.h"

namespace clearance::cli {
namespace {

struct Arguments {
  uint64_t count = 0;
  double max_rate_hz = 0;
  bool poses_only = false;
};

Json EventJson(const client::WatchEvent& event) {
  Json json = {{"kind", event.checkpoint ? "checkpoint" : "delta"},
               {"prev_revision", event.prev_revision},
               {"stamp", cli::ToJson(event.stamp)},
               {"blocks", event.blocks},
               {"removed_blocks", event.removed_blocks},
               {"bytes", event.bytes},
               {"block_bytes", event.block_bytes},
               {"object_bytes", event.object_bytes},
               {"evicted_objects", event.evicted_objects},
               {"lag_ms", event.stamp.staleness_s * 1e3},
               {"objects", Json::array()}};
  for (const client::ObjectBrief& object : event.objects) {
    json["objects"].push_back(cli::ToJson(object));
  }
  return json;
}

absl::Status Watch(const Context& context, const Arguments& arguments) {
  const absl::StatusOr<client::ClientOptions> client = ClientOptionsOf(context);
  if (!client.ok()) return client.status();
  client::WatchOptions options;
  options.max_rate_hz = arguments.max_rate_hz;
  options.poses_only = arguments.poses_only;
  uint64_t told = 0;
  return client::WatchMap(*client, options, [&](const client::WatchEvent& event) {
    if (context.json) {
      std::cout << EventJson(event).dump() << std::endl;
    } else {
      std::cout << absl::StrFormat(
                       "%-10s revision %6d  blocks %6d  removed %4d  objects %3d  %9d bytes  lag "
                       "%7.1f ms",
                       event.checkpoint ? "checkpoint" : "delta", event.stamp.revision,
                       event.blocks, event.removed_blocks, event.objects.size(), event.bytes,
                       event.stamp.staleness_s * 1e3)
                << std::endl;
    }
    return ++told != arguments.count;
  });
}

}  // namespace

void AddWatch(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      AddCommand(app, context, "watch", "follow a map: a line for everything that it tells",
                 [&context, arguments] { return Watch(context, *arguments); });
  command->add_option("--count", arguments->count, "stop after this many lines; 0 = never");
  command->add_option("--max-rate", arguments->max_rate_hz, "lines a second at most")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--poses-only", arguments->poses_only, "objects alone, no blocks");
}

}  // namespace clearance::cli
