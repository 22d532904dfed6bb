// query: distances at one point or at the points of a file.
#include <iostream>

#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/print.h"
#include "client/sequence/text.h"

namespace clearance::cli {
namespace {

constexpr size_t kBatch = 100'000;  // the most that one call may ask

struct Arguments {
  std::vector<double> point;
  std::string points_file, out;
  double horizon_s = 0;
  bool static_only = false, weighted = false;
  double sigma_margin = 0;
};

absl::StatusOr<Eigen::Matrix3Xd> ReadPoints(const std::string& path) {
  const auto text = client::ReadWholeFile(path);
  if (!text.ok()) return absl::NotFoundError(text.status().message());
  const auto lines = client::SplitLines(*text, ',');
  // A first line without numbers names the columns.
  double ignored = 0;
  const size_t first = !lines.empty() && !client::ParseNumber(lines[0].cells[0], &ignored) ? 1 : 0;
  Eigen::Matrix3Xd points(3, lines.size() - std::min(first, lines.size()));
  for (size_t i = first; i < lines.size(); ++i) {
    const auto& cells = lines[i].cells;
    for (int k = 0; k < 3; ++k) {
      if (cells.size() >= 3 && client::ParseNumber(cells[k], &points(k, i - first))) continue;
      return client::BadLine(path, lines[i].number,
                             cells.size() < 3 ? absl::StrFormat("%d cells", cells.size())
                                              : "\"" + std::string(cells[k]) + "\"",
                             "three finite numbers x, y, z");
    }
  }
  if (points.cols() == 0) return client::BadLine(path, 1, "no points", "lines x,y,z");
  return points;
}

std::string Flags(uint8_t state) {
  std::string text;
  for (const std::string& name : FlagNames(state)) text += (text.empty() ? "" : "|") + name;
  return text;
}

Json AnswerJson(const Eigen::Matrix3Xd& points, const client::DistanceAnswers& a, size_t i) {
  return {
      {"point", ToJson(Eigen::Vector3d(points.col(i)))},
      {"distance_m", a.distances_m[i]},
      {"state", std::string(StateName(a.states[i]))},
      {"flags", FlagNames(a.states[i])},
      {"gradient", Json::array({a.gradients_W(0, i), a.gradients_W(1, i), a.gradients_W(2, i)})},
      {"object_id", a.object_ids[i]},
      {"sigma_m", a.sigmas_m[i]}};
}

std::string AnswerCsv(const Eigen::Matrix3Xd& points, const client::DistanceAnswers& a, size_t i) {
  return absl::StrFormat("%.10g,%.10g,%.10g,%.6g,%s,%s,%.6g,%.6g,%.6g,%d,%.6g\n", points(0, i),
                         points(1, i), points(2, i), a.distances_m[i],
                         std::string(StateName(a.states[i])), Flags(a.states[i]),
                         a.gradients_W(0, i), a.gradients_W(1, i), a.gradients_W(2, i),
                         a.object_ids[i], a.sigmas_m[i]);
}

void PrintOne(const Eigen::Matrix3Xd& points, const client::DistanceAnswers& a) {
  const uint8_t state = a.states[0];
  std::string near = a.object_ids[0] == 0 ? "static" : std::to_string(a.object_ids[0]);
  for (const auto& object : a.objects) {
    if (object.object_id != a.object_ids[0] || a.object_ids[0] == 0) continue;
    near += absl::StrFormat(" %s, %.2f m/s", object.class_name, object.twist.linear_mps.norm());
  }
  Table table(
      {"point", absl::StrFormat("(%g, %g, %g) m", points(0, 0), points(1, 0), points(2, 0))});
  table.Add({"distance", absl::StrFormat("%.3f m", a.distances_m[0])});
  table.Add({"state", std::string(StateName(state)) +
                          (Flags(state).empty() ? "" : " (" + Flags(state) + ")")});
  table.Add({"gradient", absl::StrFormat("(%.3f, %.3f, %.3f)", a.gradients_W(0, 0),
                                         a.gradients_W(1, 0), a.gradients_W(2, 0))});
  table.Add({"nearest", near});
  table.Add({"sigma", absl::StrFormat("%.3f m", a.sigmas_m[0])});
  table.Add(
      {"revision", absl::StrFormat("%d, stamp %.3f s", a.stamp.revision, a.stamp.stamp_ns * 1e-9)});
  std::cout << table.Text();
}

absl::Status Query(const Context& context, const Arguments& arguments) {
  Eigen::Matrix3Xd points(3, 1);
  if (!arguments.points_file.empty()) {
    auto read = ReadPoints(arguments.points_file);
    if (!read.ok()) return read.status();
    points = *std::move(read);
  } else {
    points << arguments.point[0], arguments.point[1], arguments.point[2];
  }
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  client::QueryOptions options;
  options.horizon_s = arguments.horizon_s;
  options.static_only = arguments.static_only;
  options.weighted_fusion = arguments.weighted;
  options.sigma_margin = arguments.sigma_margin;
  options.gradients = options.objects = options.sigmas = true;

  const bool file = !arguments.out.empty();
  std::string csv = "x,y,z,distance_m,state,flags,gx,gy,gz,object_id,sigma_m\n";
  Json json = {{"map", context.MapName()}, {"horizon_s", arguments.horizon_s}};
  json["answers"] = Json::array();
  for (Eigen::Index begin = 0; begin < points.cols(); begin += kBatch) {
    const Eigen::Matrix3Xd batch =
        points.middleCols(begin, std::min<Eigen::Index>(kBatch, points.cols() - begin));
    const auto answers = (*client)->QueryPoints(batch, options);
    if (!answers.ok()) return answers.status();
    json["stamp"] = ToJson(answers->stamp);
    for (Eigen::Index i = 0; i < batch.cols(); ++i) {
      if (file || (!context.json && arguments.point.empty())) csv += AnswerCsv(batch, *answers, i);
      if (context.json && !file) json["answers"].push_back(AnswerJson(batch, *answers, i));
    }
    if (!context.json && !file && !arguments.point.empty()) PrintOne(batch, *answers);
  }
  if (file) {
    if (absl::Status s = WriteFile(arguments.out, csv); !s.ok()) return s;
    json.erase("answers");
    json["file"] = arguments.out;
    json["points"] = points.cols();
  }
  if (context.json) {
    PrintJson(json);
  } else if (file) {
    std::cout << arguments.out << ": " << points.cols() << " answers\n";
  } else if (arguments.point.empty()) {
    std::cout << csv;
  }
  return absl::OkStatus();
}

}  // namespace

void AddQuery(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      AddCommand(app, context, "query", "distance to the nearest surface at points of the world",
                 [&context, arguments] { return Query(context, *arguments); });
  auto* point = command->add_option("point", arguments->point, "x y z, metres")->expected(3);
  auto* file = command->add_option("--points", arguments->points_file, "FILE.csv with x,y,z lines");
  point->excludes(file);
  command->add_option("--out", arguments->out, "answers as FILE.csv");
  command->add_option("--horizon", arguments->horizon_s, "seconds after the map's stamp");
  command->add_flag("--static-only", arguments->static_only, "without the objects");
  command->add_flag("--weighted", arguments->weighted, "the paper's weighted mean");
  command
      ->add_option("--sigma-margin", arguments->sigma_margin,
                   "subtract this many standard deviations")
      ->check(CLI::NonNegativeNumber);
  command->parse_complete_callback([arguments] {
    if (arguments->point.empty() && arguments->points_file.empty()) {
      throw CLI::ValidationError("query", "got no point, expected X Y Z or --points FILE.csv");
    }
  });
}

}  // namespace clearance::cli
