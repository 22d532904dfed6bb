// map create, list, delete and edit.
#include <iostream>

#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/print.h"

namespace clearance::cli {
namespace {

struct CreateArguments {
  std::string map;
  double voxel_size_m = 0, max_distance_m = 0, truncation_m = 0, max_range_m = 0, max_horizon_s = 0;
  std::vector<double> bounds;
  bool drop_oldest_static = false;
};

struct EditArguments {
  std::vector<double> box, sphere;
  std::string action;
};

absl::Status Create(const Context& context, const CreateArguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  wire::MapSettings settings;
  const auto set = [](double value, std::optional<double>& target) {
    if (value != 0) target = value;
  };
  set(arguments.voxel_size_m, settings.voxel_size_m);
  set(arguments.max_distance_m, settings.max_distance_m);
  set(arguments.truncation_m, settings.truncation_m);
  set(arguments.max_range_m, settings.max_range_m);
  set(arguments.max_horizon_s, settings.max_horizon_s);
  if (arguments.drop_oldest_static) settings.drop_oldest_static = true;
  if (const auto& b = arguments.bounds; b.size() == 6) {
    settings.bounds = Aabb(Eigen::Vector3d(b[0], b[1], b[2]), Eigen::Vector3d(b[3], b[4], b[5]));
  }
  const std::string name = arguments.map.empty() ? context.MapName() : arguments.map;
  const auto info = (*client)->CreateMap(name, settings);
  if (!info.ok()) return info.status();
  if (context.json) {
    PrintJson(ToJson(*info));
  } else {
    std::cout << absl::StrFormat("created map %s, voxel size %g m\n", info->map,
                                 info->settings.voxel_size_m.value_or(0));
  }
  return absl::OkStatus();
}

absl::Status List(const Context& context) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const auto maps = (*client)->ListMaps();
  if (!maps.ok()) return maps.status();
  if (context.json) {
    Json json = {{"maps", Json::array()}};
    for (const auto& map : *maps) json["maps"].push_back(ToJson(map));
    PrintJson(json);
    return absl::OkStatus();
  }
  Table table({"map", "revision", "voxel m", "objects", "memory"});
  for (const auto& map : *maps) {
    table.Add({map.map, std::to_string(map.stamp.revision),
               Number(map.settings.voxel_size_m.value_or(0), 3), std::to_string(map.live_objects),
               Bytes(map.memory_bytes)});
  }
  std::cout << table.Text();
  return absl::OkStatus();
}

absl::Status Delete(const Context& context, const std::string& map) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  const std::string name = map.empty() ? context.MapName() : map;
  if (absl::Status s = (*client)->DeleteMap(name); !s.ok()) return s;
  if (context.json) {
    PrintJson({{"deleted", name}});
  } else {
    std::cout << "deleted map " << name << "\n";
  }
  return absl::OkStatus();
}

absl::Status Edit(const Context& context, const EditArguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  wire::EditRegion edit;
  if (const auto& b = arguments.box; b.size() == 6) {
    edit.box = Aabb(Eigen::Vector3d(b[0], b[1], b[2]), Eigen::Vector3d(b[3], b[4], b[5]));
  }
  if (const auto& s = arguments.sphere; s.size() == 4) {
    edit.sphere = wire::EditRegion::Ball{Eigen::Vector3d(s[0], s[1], s[2]), s[3]};
  }
  edit.action = arguments.action == "free"       ? v1::EDIT_ACTION_MARK_FREE
                : arguments.action == "occupied" ? v1::EDIT_ACTION_MARK_OCCUPIED
                                                 : v1::EDIT_ACTION_CLEAR_TO_UNKNOWN;
  const auto stamp = (*client)->EditRegion(context.map, edit);
  if (!stamp.ok()) return stamp.status();
  if (context.json) {
    PrintJson({{"stamp", ToJson(*stamp)}});
  } else {
    std::cout << "edited; revision " << stamp->revision << "\n";
  }
  return absl::OkStatus();
}

}  // namespace

void AddMap(CLI::App& app, Context& context) {
  CLI::App* map = app.add_subcommand("map", "create, list, delete and edit maps");
  map->require_subcommand(1);

  auto create = std::make_shared<CreateArguments>();
  CLI::App* command = AddCommand(*map, context, "create", "make an empty map",
                                 [&context, create] { return Create(context, *create); });
  command->add_option("name", create->map, "the new map's id");
  command->add_option("--voxel-size-m", create->voxel_size_m)->check(CLI::PositiveNumber);
  command->add_option("--max-distance-m", create->max_distance_m)->check(CLI::PositiveNumber);
  command->add_option("--truncation-m", create->truncation_m)->check(CLI::PositiveNumber);
  command->add_option("--max-range-m", create->max_range_m)->check(CLI::PositiveNumber);
  command->add_option("--max-horizon-s", create->max_horizon_s)->check(CLI::PositiveNumber);
  command->add_option("--bounds", create->bounds, "min x y z, max x y z")->expected(6);
  command->add_flag("--drop-oldest-static", create->drop_oldest_static,
                    "under overload drop points instead of waiting");

  AddCommand(*map, context, "list", "all maps of the server", [&context] { return List(context); });

  auto deleted = std::make_shared<std::string>();
  command = AddCommand(*map, context, "delete", "forget a map",
                       [&context, deleted] { return Delete(context, *deleted); });
  command->add_option("name", *deleted, "the map's id");

  auto edit = std::make_shared<EditArguments>();
  command = AddCommand(*map, context, "edit", "change a region of the static map by hand",
                       [&context, edit] { return Edit(context, *edit); });
  auto* box = command->add_option("--box", edit->box, "min x y z, max x y z")->expected(6);
  auto* sphere = command->add_option("--sphere", edit->sphere, "x y z radius")->expected(4);
  box->excludes(sphere);
  command->add_option("--action", edit->action)
      ->required()
      ->check(CLI::IsMember({"free", "occupied", "unknown"}));
}

}  // namespace clearance::cli
