// health, info and version.
#include <iostream>

#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/print.h"

namespace clearance::cli {
namespace {

#ifndef CLEARANCE_VERSION
#define CLEARANCE_VERSION "unknown"
#endif

absl::Status Health(const Context& context, const std::string& service) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto serving = (*client)->IsServing(service);
  if (!serving.ok()) return serving.status();
  if (context.json) {
    PrintJson({{"server", context.server}, {"service", service}, {"serving", *serving}});
  } else if (*serving) {
    std::cout << "serving\n";
  }
  if (*serving) return absl::OkStatus();
  return absl::UnavailableError(absl::StrFormat(
      "the server at %s answers but is not serving (loading or draining); try again",
      context.server));
}

absl::Status Info(const Context& context) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto server = (*client)->GetServerInfo();
  if (!server.ok()) return server.status();
  const auto map = (*client)->GetMap();
  if (!map.ok()) return map.status();
  if (context.json) {
    Json json = ToJson(*map);
    json["server"] = {{"address", context.server},
                      {"version", server->version},
                      {"api_version", server->api_version},
                      {"build", server->build},
                      {"uptime_s", server->uptime_s},
                      {"maps", server->maps},
                      {"draining", server->draining},
                      {"max_query_points", server->max_query_points},
                      {"max_frame_points", server->max_frame_points}};
    PrintJson(json);
    return absl::OkStatus();
  }
  Table table({"server", context.server});
  table.Add({"version", server->version + " (" + server->api_version + ")"});
  table.Add({"up", absl::FormatDuration(absl::Seconds(static_cast<int64_t>(server->uptime_s)))});
  table.Add({"map", map->map});
  table.Add({"revision", absl::StrFormat("%d (field %d, epoch %d)", map->stamp.revision,
                                         map->stamp.field_revision, map->stamp.epoch)});
  table.Add({"stamp", absl::StrFormat("%.3f s", map->stamp.stamp_ns * 1e-9)});
  table.Add({"staleness", absl::StrFormat("%.1f s", map->stamp.staleness_s)});
  table.Add({"voxel size", absl::StrFormat("%g m", map->settings.voxel_size_m.value_or(0))});
  table.Add({"distances to", absl::StrFormat("%g m", map->settings.max_distance_m.value_or(0))});
  if (map->observed_bounds) {
    const Aabb& b = *map->observed_bounds;
    table.Add({"observed",
               absl::StrFormat("(%.1f, %.1f, %.1f) to (%.1f, %.1f, %.1f) m", b.min().x(),
                               b.min().y(), b.min().z(), b.max().x(), b.max().y(), b.max().z())});
  }
  table.Add({"memory", Bytes(map->memory_bytes)});
  table.Add(
      {"objects", absl::StrFormat("%d alive, %d known", map->live_objects, map->known_objects)});
  for (const auto& s : map->sources) {
    table.Add(
        {"source",
         absl::StrFormat("%s: last frame %s, %d integrated, %d dropped, %d rejected", s.source_id,
                         s.last_frame_id ? std::to_string(*s.last_frame_id) : "none",
                         s.frames_integrated, s.frames_dropped, s.frames_rejected)});
  }
  std::cout << table.Text();
  return absl::OkStatus();
}

}  // namespace

void AddHealth(CLI::App& app, Context& context) {
  auto service = std::make_shared<std::string>();
  CLI::App* command =
      AddCommand(app, context, "health", "whether the server is serving (exit code 0) or not (5)",
                 [&context, service] { return Health(context, *service); });
  command->add_option("--service", *service, "a service of the server; empty: all of it");
}

void AddInfo(CLI::App& app, Context& context) {
  AddCommand(app, context, "info", "the server and a map: revision, extent, memory, sources",
             [&context] { return Info(context); });
}

void AddVersion(CLI::App& app, Context& context) {
  AddCommand(app, context, "version", "the version of this command", [&context] {
    if (context.json) {
      PrintJson({{"version", CLEARANCE_VERSION}, {"api_version", "v1"}});
    } else {
      std::cout << "clearance " << CLEARANCE_VERSION << " (clearance.v1)\n";
    }
    return absl::OkStatus();
  });
}

}  // namespace clearance::cli
