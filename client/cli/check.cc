// check: whether a robot can follow a timed path.
#include <iostream>

#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/print.h"
#include "client/sequence/text.h"

namespace clearance::cli {
namespace {

struct Arguments {
  std::vector<double> from, to;
  double start_s = 0, duration_s = 1;
  std::string path_file;
  std::vector<double> spheres;  // x y z radius each
  double radius_m = 0, margin_m = 0, sigma_margin = 0;
  bool unknown_free = false, static_only = false;
};

// Lines t,x,y,z or t,x,y,z,qx,qy,qz,qw.
absl::StatusOr<client::Trajectory> ReadPath(const std::string& path) {
  const auto text = client::ReadWholeFile(path);
  if (!text.ok()) return absl::NotFoundError(text.status().message());
  const auto lines = client::SplitLines(*text, ',');
  // A first line without numbers names the columns.
  double ignored = 0;
  const size_t first = !lines.empty() && !client::ParseNumber(lines[0].cells[0], &ignored) ? 1 : 0;
  client::Trajectory trajectory;
  for (size_t i = first; i < lines.size(); ++i) {
    const auto& cells = lines[i].cells;
    double v[8] = {0, 0, 0, 0, 0, 0, 0, 1};
    if (cells.size() != 4 && cells.size() != 8) {
      return client::BadLine(path, lines[i].number, absl::StrFormat("%d cells", cells.size()),
                             "t,x,y,z or t,x,y,z,qx,qy,qz,qw");
    }
    for (size_t k = 0; k < cells.size(); ++k) {
      if (client::ParseNumber(cells[k], &v[k])) continue;
      return client::BadLine(path, lines[i].number, "\"" + std::string(cells[k]) + "\"",
                             "a finite number");
    }
    const Eigen::Quaterniond q(v[7], v[4], v[5], v[6]);
    if (std::abs(q.norm() - 1) > 1e-3) {
      return client::BadLine(path, lines[i].number,
                             absl::StrFormat("a quaternion of length %g", q.norm()), "unit length");
    }
    Pose T_W_R(q.normalized());
    T_W_R.translation() << v[1], v[2], v[3];
    trajectory.T_W_R.push_back(T_W_R);
    trajectory.times_s.push_back(v[0]);
  }
  return trajectory;
}

client::Trajectory Straight(const Arguments& arguments) {
  client::Trajectory trajectory;
  for (const auto& point : {arguments.from, arguments.to}) {
    Pose T_W_R = Pose::Identity();
    T_W_R.translation() << point[0], point[1], point[2];
    trajectory.T_W_R.push_back(T_W_R);
  }
  trajectory.times_s = {arguments.start_s, arguments.start_s + arguments.duration_s};
  return trajectory;
}

Json ResultJson(const client::TrajectoryResult& result) {
  Json json = {{"collides", result.collides}};
  json["first_collision_s"] = result.collides ? Json(result.first_collision_s) : Json();
  json["last_valid_s"] = result.last_valid_s ? Json(*result.last_valid_s) : Json();
  json["last_valid_index"] = result.last_valid_index ? Json(*result.last_valid_index) : Json();
  json["min_clearance_m"] = result.min_clearance_m;
  json["min_clearance_s"] = result.min_clearance_s;
  json["object_id"] = result.object_id;
  json["object_speed_mps"] = result.twist.linear_mps.norm();
  json["unknown_decides"] = result.unknown_decides;
  return json;
}

void Print(const client::TrajectoryAnswers& answers) {
  const client::TrajectoryResult& result = answers.results[0];
  Table table({"path", result.collides
                           ? absl::StrFormat("collides at %.3f s", result.first_collision_s)
                           : "is free"});
  table.Add({"last valid", result.last_valid_s
                               ? absl::StrFormat("%.3f s, behind waypoint %d", *result.last_valid_s,
                                                 *result.last_valid_index)
                               : "never"});
  table.Add({"least clearance",
             absl::StrFormat("%.3f m at %.3f s", result.min_clearance_m, result.min_clearance_s)});
  std::string nearest = "static";
  if (result.unknown_decides) {
    nearest = "unknown space";
  } else if (result.object_id != 0) {
    nearest =
        absl::StrFormat("object %d, %.2f m/s", result.object_id, result.twist.linear_mps.norm());
  }
  table.Add({"nearest there", nearest});
  table.Add({"revision", absl::StrFormat("%d, stamp %.3f s", answers.stamp.revision,
                                         answers.stamp.stamp_ns * 1e-9)});
  std::cout << table.Text();
}

absl::Status Check(const Context& context, const Arguments& arguments) {
  client::Trajectory trajectory;
  if (arguments.path_file.empty()) {
    trajectory = Straight(arguments);
  } else {
    auto read = ReadPath(arguments.path_file);
    if (!read.ok()) return read.status();
    trajectory = *std::move(read);
  }
  std::vector<client::Sphere> robot;
  if (arguments.radius_m != 0) {
    robot.push_back({Eigen::Vector3f::Zero(), static_cast<float>(arguments.radius_m)});
  }
  for (size_t i = 0; i + 3 < arguments.spheres.size(); i += 4) {
    const double* s = arguments.spheres.data() + i;
    robot.push_back({Eigen::Vector3d(s[0], s[1], s[2]).cast<float>(), static_cast<float>(s[3])});
  }
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  client::CheckOptions options;
  options.margin_m = arguments.margin_m;
  options.unknown_as_free = arguments.unknown_free;
  options.sigma_margin = arguments.sigma_margin;
  options.static_only = arguments.static_only;
  const auto answers = (*client)->CheckTrajectories(robot, {trajectory}, options);
  if (!answers.ok()) return answers.status();
  if (context.json) {
    Json json = {{"map", context.MapName()}, {"stamp", ToJson(answers->stamp)}};
    json.update(ResultJson(answers->results[0]));
    PrintJson(json);
  } else {
    Print(*answers);
  }
  return absl::OkStatus();
}

}  // namespace

void AddCheck(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = AddCommand(app, context, "check", "whether a robot can follow a timed path",
                                 [&context, arguments] { return Check(context, *arguments); });
  auto* from = command->add_option("--from", arguments->from, "x y z, metres")->expected(3);
  auto* to = command->add_option("--to", arguments->to, "x y z, metres")->expected(3);
  from->needs(to);
  to->needs(from);
  command->add_option("--start", arguments->start_s, "seconds after the map's stamp");
  command->add_option("--duration", arguments->duration_s, "seconds (default 1)")
      ->check(CLI::PositiveNumber);
  auto* file = command->add_option("--path", arguments->path_file,
                                   "FILE.csv with lines t,x,y,z[,qx,qy,qz,qw]");
  file->excludes(from)->excludes(to);
  command->add_option("--radius", arguments->radius_m, "of a robot that is one sphere, metres")
      ->check(CLI::PositiveNumber);
  command->add_option("--sphere", arguments->spheres, "x y z radius in the robot's frame; repeat")
      ->type_size(4)
      ->expected(1, 1000);
  command->add_option("--margin", arguments->margin_m, "metres")->check(CLI::NonNegativeNumber);
  command
      ->add_option("--sigma-margin", arguments->sigma_margin,
                   "subtract this many standard deviations")
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--unknown-free", arguments->unknown_free, "unknown space does not block");
  command->add_flag("--static-only", arguments->static_only, "without the objects");
  command->parse_complete_callback([arguments] {
    if (arguments->from.empty() && arguments->path_file.empty()) {
      throw CLI::ValidationError("check",
                                 "got no path, expected --from X Y Z --to X Y Z or --path "
                                 "FILE.csv");
    }
    if (arguments->radius_m == 0 && arguments->spheres.empty()) {
      throw CLI::ValidationError("check", "got no robot, expected --radius R or --sphere X Y Z R");
    }
  });
}

}  // namespace clearance::cli
