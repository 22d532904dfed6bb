#include "planner_demo/episode/episode.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"

namespace clearance::demo {
namespace {

constexpr double kEpsilon_s = 1e-9;
constexpr double kStaticAround_m = 4.0;
constexpr double kTrafficAround_m = 45.0;

std::string MapOf(const Stage& stage, Row row) {
  std::string name = absl::StrFormat("%s-%s-%d", stage.name, NameOf(row), stage.seed);
  std::replace(name.begin(), name.end(), '_', '-');
  return name;
}

void Conclude(const Stage& stage, double ended_s, EpisodeResult& result) {
  const Verdict& verdict = result.verdict;
  result.driven_s = ended_s - stage.start_s;
  if (verdict.collision) {
    const Collision& c = *verdict.collision;
    result.outcome = absl::StrFormat(
        "%s %s at %.2f s: %s", c.caused ? "hit" : "was hit by",
        c.object_id == 0 ? "something static" : absl::StrFormat("object %d", c.object_id), c.time_s,
        c.cause);
    return;
  }
  const double took_s = verdict.reached_s ? *verdict.reached_s - stage.start_s : INFINITY;
  result.in_time = took_s <= 2.0 * stage.unobstructed_s + kEpsilon_s;
  if (result.in_time) {
    result.time_to_goal_s = took_s;
    result.outcome = absl::StrFormat("at the goal after %.1f s", took_s);
  } else {
    result.outcome = absl::StrFormat("not at the goal within %.1f s", 2.0 * stage.unobstructed_s);
  }
  if (!result.map_lost.empty()) result.outcome += "; lost the map " + result.map_lost;
}

EpisodeResult RunStraight(const Stage& stage, const EpisodeOptions& options) {
  EpisodeResult result;
  result.row = Row::kStraightAhead;
  result.seed = stage.seed;
  const Trajectory drive = StraightAhead(stage.robot, stage.mission, stage.start_s);
  Judge judge(*stage.truth, stage.robot, stage.mission);
  double t = stage.start_s;
  for (uint64_t frame = static_cast<uint64_t>(std::llround(t / stage.frame_s));
       t < drive.ends_s() + 0.5 && !judge.verdict().collision; ++frame) {
    if (options.observer) {
      const RobotState robot = drive.At(t);
      options.observer({t, frame, robot, drive, nullptr, ""});
    }
    judge.Advance([&](double at_s) { return drive.At(at_s); }, t, t + stage.frame_s);
    t += stage.frame_s;
  }
  result.verdict = judge.verdict();
  Conclude(stage, t, result);
  return result;
}

}  // namespace

void Surround(Stage& stage) {
  const Eigen::Vector3d below(0.0, 0.0, 0.45), above(0.0, 0.0, 2.2);
  const Aabb reach(stage.mission.min_W - below, stage.mission.max_W + above);
  const auto grown = [&reach](double by_m) {
    const Eigen::Vector3d around(by_m, by_m, 0.0);
    return Aabb(reach.min() - around, reach.max() + around);
  };
  stage.static_bounds = grown(kStaticAround_m);
  stage.map_bounds = grown(kTrafficAround_m);
}

const char* NameOf(Row row) {
  switch (row) {
    case Row::kClearance:
      return "clearance";
    case Row::kFrozenSnapshot:
      return "frozen_snapshot";
    case Row::kStaticFusion:
      return "static_fusion";
    case Row::kStraightAhead:
      return "straight_ahead";
  }
  return "";
}

absl::StatusOr<EpisodeResult> RunEpisode(const Stage& stage, const client::EsdfClient* client,
                                         const EpisodeOptions& options) {
  if (options.row == Row::kStraightAhead) return RunStraight(stage, options);
  wire::MapSettings settings;
  settings.voxel_size_m = options.voxel_size_m;
  settings.max_range_m = stage.max_range_m;
  settings.max_distance_m = 2.0;  // nobody needs to know more than that there is room
  settings.max_horizon_s = options.max_horizon_s;
  settings.bounds = stage.map_bounds;
  auto link = MapLink::Open(*client, MapOf(stage, options.row), settings, stage.max_range_m,
                            options.source);
  if (!link.ok()) return link.status();

  ClearanceProbe probe((*link)->lookup(), stage.robot, options.margins,
                       options.row == Row::kFrozenSnapshot, options.max_horizon_s);
  PilotOptions pilot_options = options.pilot;
  pilot_options.planner.seed = stage.seed;
  Pilot pilot(stage.robot, stage.mission, probe, pilot_options);
  Judge judge(*stage.truth, stage.robot, stage.mission);
  const auto drive = [&](double time_s) { return pilot.At(time_s); };

  EpisodeResult result;
  result.row = options.row;
  result.seed = stage.seed;
  const double first_plan_s = stage.start_s - options.pilot.latency_s;
  double t = 0.0;
  for (uint64_t frame = 0; t < stage.ends_s + kEpsilon_s; ++frame) {
    t = static_cast<double>(frame) * stage.frame_s;
    const RobotState robot = pilot.At(t);
    auto seen = stage.see(frame, robot, options.row != Row::kStaticFusion);
    if (!seen.ok()) return seen.status();
    if (*seen && result.map_lost.empty()) {
      const absl::Status integrated = (*link)->Integrate(**seen);
      if (integrated.ok()) {
        result.integrate_ms.push_back((*link)->integrate_ms());
      } else if (frame == 0) {
        return integrated;
      } else {
        // Time goes on, the map grows old: what the robot does now is up to the pilot.
        result.map_lost = absl::StrFormat("at %.1f s: %s", t, integrated.message());
      }
    }
    Cycle cycle;
    const bool plans =
        frame % options.plan_every == 0 && t >= first_plan_s - kEpsilon_s && seen->has_value();
    if (plans) {
      cycle = pilot.Plan(t, (*link)->map_time_s());
      result.cycles.push_back(cycle);
    }
    if (options.observer) {
      options.observer({t, frame, robot, pilot.plan(), plans ? &cycle : nullptr, (*link)->map()});
    }
    if (t >= stage.start_s - kEpsilon_s) judge.Advance(drive, t, t + stage.frame_s);
    if (judge.verdict().collision || judge.verdict().reached_s) break;
  }
  result.verdict = judge.verdict();
  Conclude(stage, t, result);
  return result;
}

}  // namespace clearance::demo
