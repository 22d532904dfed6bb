// slice: a horizontal cut as a picture.
#include <algorithm>
#include <iostream>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/cli/context.h"
#include "client/cli/ingest_counts.h"
#include "client/cli/print.h"
#include "client/draw/slice_picture.h"

namespace clearance::cli {
namespace {

struct Arguments {
  double z_m = 0;
  std::string out;
  double horizon_s = 0;
  double resolution_m = 0;
  std::vector<double> bounds;
  bool static_only = false, weighted = false;
  double max_m = 0;
  int width = 1200;
};

Json Counts(const client::Slice& slice) {
  size_t counts[3] = {};
  for (const uint8_t state : slice.states) {
    if ((state & 3) < 3) ++counts[state & 3];
  }
  return {{"unknown", counts[0]}, {"free", counts[1]}, {"occupied", counts[2]}};
}

// A round end of the colour scale, so that nearly all of the free space differs in colour.
double ScaleEnd(const client::Slice& slice, double max_distance_m) {
  std::vector<double> free_m;
  for (size_t i = 0; i < slice.states.size(); ++i) {
    if (client::StateOf(slice.states[i]) == client::SpaceState::kFree) {
      free_m.push_back(slice.distances_m[i]);
    }
  }
  const double reached_m = Percentile(std::move(free_m), 0.98);
  for (const double end_m : {0.5, 1.0, 2.0, 3.0, 5.0, 10.0}) {
    if (reached_m <= end_m) return std::min(end_m, max_distance_m);
  }
  return max_distance_m;
}

absl::Status Slice(const Context& context, const Arguments& arguments) {
  const auto client = context.Connect();
  if (!client.ok()) return client.status();
  client::SliceOptions options;
  options.z_m = arguments.z_m;
  options.resolution_m = arguments.resolution_m;
  options.query.horizon_s = arguments.horizon_s;
  options.query.static_only = arguments.static_only;
  options.query.weighted_fusion = arguments.weighted;
  if (const auto& b = arguments.bounds; b.size() == 4) {
    options.bounds = Aabb(Eigen::Vector3d(b[0], b[1], arguments.z_m),
                          Eigen::Vector3d(b[2], b[3], arguments.z_m));
  }
  const auto slice = (*client)->GetSlice(options);
  if (!slice.ok()) return slice.status();
  const auto map = (*client)->GetMap("", /*include_trajectory=*/true);
  if (!map.ok()) return map.status();

  client::SlicePicture picture;
  picture.title = absl::StrFormat("%s  z = %g m  t = %.2f s", map->map, arguments.z_m,
                                  slice->stamp.stamp_ns * 1e-9);
  if (arguments.horizon_s != 0) picture.title += absl::StrFormat(" + %g s", arguments.horizon_s);
  picture.title += absl::StrFormat("  revision %d", slice->stamp.revision);
  picture.max_distance_m = arguments.max_m > 0
                               ? arguments.max_m
                               : ScaleEnd(*slice, map->settings.max_distance_m.value_or(5));
  picture.target_width = arguments.width;
  picture.sensor_path = map->sensor_path;
  if (!arguments.static_only) {
    const auto objects = (*client)->ListObjects(/*include_history=*/true);
    if (!objects.ok()) return objects.status();
    // Poses are of the slice's own revision; only the paths may reach a little farther.
    picture.objects = slice->objects;
    for (client::ObjectInfo& object : picture.objects) {
      for (const client::ObjectInfo& listed : objects->objects) {
        if (listed.brief.object_id == object.brief.object_id &&
            listed.brief.generation == object.brief.generation) {
          object.history = listed.history;
        }
      }
    }
  }
  const client::Canvas canvas = DrawSlice(*slice, picture);
  if (absl::Status s = canvas.WritePng(arguments.out); !s.ok()) return s;
  if (context.json) {
    PrintJson({{"file", arguments.out},
               {"stamp", ToJson(slice->stamp)},
               {"z_m", arguments.z_m},
               {"origin", ToJson(slice->origin_W)},
               {"resolution_m", slice->resolution_m},
               {"columns", slice->columns},
               {"rows", slice->rows},
               {"cells", Counts(*slice)},
               {"width_px", canvas.width()},
               {"height_px", canvas.height()}});
  } else {
    std::cout << absl::StrFormat("%s: %d x %d cells of %g m, revision %d\n", arguments.out,
                                 slice->columns, slice->rows, slice->resolution_m,
                                 slice->stamp.revision);
  }
  return absl::OkStatus();
}

}  // namespace

void AddSlice(CLI::App& app, Context& context) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = AddCommand(app, context, "slice", "a horizontal cut as a picture",
                                 [&context, arguments] { return Slice(context, *arguments); });
  command->add_option("--z", arguments->z_m, "height of the cut, metres")->required();
  command->add_option("--out", arguments->out, "FILE.png")
      ->required()
      ->check([](const std::string& path) {
        return absl::EndsWithIgnoreCase(path, ".png")
                   ? std::string()
                   : "got " + path + ", expected a name ending in .png";
      });
  command->add_option("--horizon", arguments->horizon_s, "seconds after the map's stamp");
  command->add_option("--resolution-m", arguments->resolution_m, "side of a cell")
      ->check(CLI::PositiveNumber);
  command->add_option("--bounds", arguments->bounds, "min x y, max x y")->expected(4);
  command->add_flag("--static-only", arguments->static_only, "without the objects");
  command->add_flag("--weighted", arguments->weighted, "the paper's weighted mean");
  command->add_option("--max-m", arguments->max_m, "end of the colour scale")
      ->check(CLI::PositiveNumber);
  command->add_option("--width", arguments->width, "of the map in pixels, about")
      ->check(CLI::Range(100, 8000))
      ->capture_default_str();
}

}  // namespace clearance::cli
