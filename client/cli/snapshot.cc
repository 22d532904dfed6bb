// snapshot create, list, restore and delete.
#include <iostream>

#include "absl/strings/str_format.h"
#include "absl/time/time.h"
#include "client/cli/context.h"
#include "client/cli/print.h"

namespace clearance::cli {
namespace {

struct Arguments {
  std::string id, comment;
};

Json ToJson(const client::SnapshotInfo& info) {
  return {{"map", info.map},
          {"snapshot_id", info.snapshot_id},
          {"stamp", cli::ToJson(info.stamp)},
          {"total_bytes", info.total_bytes},
          {"format_version", info.format_version},
          {"created_unix_ns", info.created_unix_ns},
          {"comment", info.comment}};
}

absl::Status Create(const Context& context, const Arguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto info = (*client)->CreateSnapshot(context.map, arguments.id, arguments.comment);
  if (!info.ok()) return info.status();
  if (context.json) {
    PrintJson(ToJson(*info));
  } else {
    std::cout << absl::StrFormat("created snapshot %s of map %s at revision %d, %s\n",
                                 info->snapshot_id, info->map, info->stamp.revision,
                                 Bytes(info->total_bytes));
  }
  return absl::OkStatus();
}

absl::Status List(const Context& context) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto snapshots = (*client)->ListSnapshots(context.map);
  if (!snapshots.ok()) return snapshots.status();
  if (context.json) {
    Json json = {{"snapshots", Json::array()}};
    for (const auto& info : *snapshots) json["snapshots"].push_back(ToJson(info));
    PrintJson(json);
    return absl::OkStatus();
  }
  Table table({"snapshot", "revision", "created (UTC)", "size", "comment"});
  for (const auto& info : *snapshots) {
    table.Add({info.snapshot_id, std::to_string(info.stamp.revision),
               absl::FormatTime("%Y-%m-%d %H:%M:%S", absl::FromUnixNanos(info.created_unix_ns),
                                absl::UTCTimeZone()),
               Bytes(info.total_bytes), info.comment});
  }
  std::cout << table.Text();
  return absl::OkStatus();
}

absl::Status Restore(const Context& context, const std::string& id) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto stamp = (*client)->RestoreSnapshot(context.map, id);
  if (!stamp.ok()) return stamp.status();
  if (context.json) {
    PrintJson({{"restored", id}, {"stamp", cli::ToJson(*stamp)}});
  } else {
    std::cout << absl::StrFormat("restored snapshot %s: revision %d of epoch %d\n", id,
                                 stamp->revision, stamp->epoch);
  }
  return absl::OkStatus();
}

absl::Status Delete(const Context& context, const std::string& id) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  if (absl::Status s = (*client)->DeleteSnapshot(context.map, id); !s.ok()) return s;
  if (context.json) {
    PrintJson({{"deleted", id}});
  } else {
    std::cout << "deleted snapshot " << id << "\n";
  }
  return absl::OkStatus();
}

}  // namespace

void AddSnapshot(CLI::App& app, Context& context) {
  CLI::App* snapshot =
      app.add_subcommand("snapshot", "create, list, restore and delete snapshots of a map");
  snapshot->require_subcommand(1);
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = AddCommand(*snapshot, context, "create", "write the map to the server's disk",
                                 [&context, arguments] { return Create(context, *arguments); });
  command->add_option("id", arguments->id, "the snapshot's id; the server names it otherwise");
  command->add_option("--comment", arguments->comment, "a note for people");
  AddCommand(*snapshot, context, "list", "all snapshots of the map, newest first",
             [&context] { return List(context); });
  command = AddCommand(*snapshot, context, "restore", "go back to a snapshot; a new epoch begins",
                       [&context, arguments] { return Restore(context, arguments->id); });
  command->add_option("id", arguments->id, "the snapshot's id")->required();
  command = AddCommand(*snapshot, context, "delete", "remove a snapshot",
                       [&context, arguments] { return Delete(context, arguments->id); });
  command->add_option("id", arguments->id, "the snapshot's id")->required();
}

}  // namespace clearance::cli
