// objects: what moves, where to, how fast.
#include <iostream>

#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/print.h"

namespace clearance::cli {
namespace {

struct Arguments {
  bool trajectory = false;
  double horizon_s = 0;
};

absl::Status Objects(const Context& context, const Arguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  client::QueryOptions options;
  options.horizon_s = arguments.horizon_s;
  const auto list = (*client)->ListObjects(arguments.trajectory, options);
  if (!list.ok()) return list.status();
  if (context.json) {
    Json json = {{"map", context.MapName()},
                 {"stamp", ToJson(list->stamp)},
                 {"horizon_s", arguments.horizon_s},
                 {"objects", Json::array()}};
    for (const auto& object : list->objects) json["objects"].push_back(ToJson(object));
    PrintJson(json);
    return absl::OkStatus();
  }
  Table table({"id", "gen", "class", "state", "x m", "y m", "z m", "speed m/s", "size m",
               "last seen s", "frames"});
  for (const auto& object : list->objects) {
    const auto& brief = object.brief;
    const Eigen::Vector3d p = object.box.size_m.norm() > 0
                                  ? Eigen::Vector3d(object.box.world_from_box.translation())
                                  : Eigen::Vector3d(brief.T_W_L.translation());
    const Eigen::Vector3d& size = object.box.size_m;
    table.Add({std::to_string(brief.object_id), std::to_string(brief.generation), brief.class_name,
               std::string(NameOf(brief.life)), Number(p.x(), 2), Number(p.y(), 2),
               Number(p.z(), 2), Number(brief.twist.linear_mps.norm(), 2),
               absl::StrFormat("%.1f x %.1f x %.1f", size.x(), size.y(), size.z()),
               Number((object.last_seen_ns - list->stamp.stamp_ns) * 1e-9, 2),
               std::to_string(object.observations)});
  }
  std::cout << table.Text();
  if (arguments.trajectory) {
    Table path({"id", "stamp s", "x m", "y m", "z m"});
    for (const auto& object : list->objects) {
      for (const auto& pose : object.history) {
        const Eigen::Vector3d p = pose.pose.translation();
        path.Add({std::to_string(object.brief.object_id), Number(pose.stamp_ns * 1e-9, 3),
                  Number(p.x(), 3), Number(p.y(), 3), Number(p.z(), 3)});
      }
    }
    std::cout << "\n" << path.Text();
  }
  return absl::OkStatus();
}

}  // namespace

void AddObjects(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = AddCommand(app, context, "objects", "the moving objects of a map",
                                 [&context, arguments] { return Objects(context, *arguments); });
  command->add_flag("--trajectory", arguments->trajectory, "with their recorded poses");
  command->add_option("--horizon", arguments->horizon_s, "seconds after the map's stamp");
}

}  // namespace clearance::cli
