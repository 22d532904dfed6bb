#include "planner_demo/episode/drive_log.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace clearance::demo {
namespace {

constexpr double kSliceZ_m = 0.7;
constexpr double kSliceResolution_m = 0.2;
constexpr double kAround_m = 8.0;  // beyond the mission's bounds
constexpr double kMostDistance_m = 2.0;

nlohmann::json Flat(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

double YawOf(const Eigen::Isometry3d& T) { return std::atan2(T(1, 0), T(0, 0)); }

nlohmann::json TrueObjects(const sim::Scene& scene, double time_s) {
  nlohmann::json objects = nlohmann::json::array();
  for (const sim::Mover& mover : scene.movers) {
    Eigen::AlignedBox3d box_L;
    for (const sim::Solid& solid : mover.solids) box_L.extend(sim::Bounds(solid));
    const Eigen::Isometry3d T_W_L = mover.T_W_L(time_s);
    objects.push_back({{"id", mover.id},
                       {"center", Flat(T_W_L * box_L.center())},
                       {"yaw", YawOf(T_W_L)},
                       {"size", Flat(box_L.sizes())}});
  }
  return objects;
}

nlohmann::json MapObjects(const client::ObjectList& list) {
  nlohmann::json objects = nlohmann::json::array();
  for (const client::ObjectInfo& object : list.objects) {
    if (object.brief.life == client::ObjectLife::kRetired) continue;
    objects.push_back({{"id", object.brief.object_id},
                       {"class", object.brief.class_name},
                       {"origin", Flat(object.brief.T_W_L.translation())},
                       {"center", Flat(object.box.world_from_box.translation())},
                       {"yaw", YawOf(object.box.world_from_box)},
                       {"size", Flat(object.box.size_m)},
                       {"velocity", Flat(object.brief.twist.linear_mps)},
                       {"yaw_rate", object.brief.twist.angular_radps.z()}});
  }
  return objects;
}

}  // namespace

DriveLog::DriveLog(const std::string& folder, const Stage& stage, const sim::Scene* scene)
    : folder_(folder), stage_(stage), scene_(scene) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  moments_.open(folder + "/moments.jsonl");
  if (!moments_) status_ = absl::UnavailableError(absl::StrCat("cannot write into ", folder));
}

void DriveLog::Add(const Moment& moment, const client::EsdfClient* client) {
  nlohmann::json line = {{"frame", moment.frame},
                         {"time_s", moment.time_s},
                         {"robot", Flat(moment.robot.position_W)},
                         {"heading", moment.robot.heading_rad},
                         {"speed", moment.robot.speed_mps}};
  nlohmann::json plan = nlohmann::json::array();
  if (!moment.plan.empty()) {
    const double from_s = std::max(moment.time_s, moment.plan.begins_s());
    for (const RobotState& state :
         moment.plan.Sample(from_s, std::max(from_s, moment.plan.ends_s()), 0.2)) {
      plan.push_back({state.position_W.x(), state.position_W.y(), state.position_W.z(),
                      state.time_s, state.speed_mps});
    }
  }
  line["plan"] = plan;
  if (scene_ != nullptr) line["truth"] = TrueObjects(*scene_, moment.time_s);
  if (moment.cycle != nullptr) {
    line["cycle"] = {{"safe", moment.cycle->safe},     {"blind", moment.cycle->blind},
                     {"late", moment.cycle->late},     {"wall_ms", moment.cycle->wall_ms},
                     {"cpu_ms", moment.cycle->cpu_ms}, {"lookups", moment.cycle->lookups},
                     {"cost", moment.cycle->cost},     {"problem", moment.cycle->problem}};
  }
  if (client != nullptr && !moment.map.empty() && moment.cycle != nullptr) {
    client::QueryOptions options;
    options.map = moment.map;
    const auto objects = client->ListObjects(false, options);
    if (objects.ok()) line["objects"] = MapObjects(*objects);
    if (!objects.ok()) status_.Update(objects.status());
    AddSlice(moment.frame, *client, moment.map);
  }
  moments_ << line.dump() << "\n";
}

void DriveLog::AddSlice(uint64_t frame, const client::EsdfClient& client, const std::string& map) {
  const Mission& mission = stage_.mission;
  const Eigen::Vector3d around(kAround_m, kAround_m, 0.0);
  client::SliceOptions options;
  options.query.map = map;
  options.z_m = kSliceZ_m;
  options.bounds = Aabb{mission.min_W - around, mission.max_W + around};
  options.resolution_m = kSliceResolution_m;
  const auto slice = client.GetSlice(options);
  if (!slice.ok()) {
    status_.Update(slice.status());
    return;
  }
  std::ofstream file(absl::StrFormat("%s/slice_%d.u8", folder_, frame), std::ios::binary);
  std::string header =
      absl::StrFormat("%d %d %.3f %.3f %.3f\n", slice->columns, slice->rows, slice->origin_W.x(),
                      slice->origin_W.y(), slice->resolution_m);
  file << header;
  for (const float distance_m : slice->distances_m) {
    file.put(static_cast<char>(
        static_cast<uint8_t>(100.0 * std::clamp<double>(distance_m, 0.0, kMostDistance_m))));
  }
  for (const uint8_t state : slice->states) file.put(static_cast<char>(state & 3));
}

absl::Status DriveLog::Finish(const EpisodeResult& result) {
  const nlohmann::json json = {{"row", NameOf(result.row)},
                               {"seed", result.seed},
                               {"outcome", result.outcome},
                               {"collides", result.verdict.collision.has_value()},
                               {"in_time", result.in_time},
                               {"min_clearance_m", result.verdict.min_clearance_m},
                               {"start", Flat(stage_.mission.start.position_W)},
                               {"goal", Flat(stage_.mission.goal_W)},
                               {"min", Flat(stage_.mission.min_W)},
                               {"max", Flat(stage_.mission.max_W)},
                               {"flies", stage_.robot.max_climb > 0.0},
                               {"radius", stage_.robot.spheres[0].radius_m}};
  std::ofstream file(folder_ + "/drive.json");
  file << json.dump(1) << "\n";
  moments_.close();
  if (!file || !moments_) {
    status_.Update(absl::UnavailableError(absl::StrCat("cannot write into ", folder_)));
  }
  return status_;
}

}  // namespace clearance::demo
