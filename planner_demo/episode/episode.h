// One drive: frames at 10 Hz into the server, plans at 5 Hz out of its map, judged by the truth.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/esdf_client.h"
#include "planner_demo/episode/judge.h"
#include "planner_demo/episode/map_link.h"
#include "planner_demo/plan/pilot.h"

namespace clearance::demo {

// The rows of the table. Each differs from the first in one thing.
enum class Row {
  kClearance,       // plans on the map and its predictions
  kFrozenSnapshot,  // every horizon is 0: the map as it is now
  kStaticFusion,    // labels and motions are taken off the frames: all is static
  kStraightAhead,   // no planning: straight and fast
};
const char* NameOf(Row row);

// What a drive takes place in. Time is the frames' clock; frame k is of k * frame_s.
struct Stage {
  std::string name;
  RobotModel robot;
  Mission mission;
  double start_s = 1.0;         // before, the robot stands and looks around
  double unobstructed_s = 0.0;  // the straight line at full speed
  double ends_s = 0.0;          // the drive is given up
  double frame_s = 0.1;
  uint64_t seed = 0;
  // Frame `index` seen by the robot at `robot`; absent where there are no more.
  std::function<absl::StatusOr<std::optional<Frame>>(uint64_t index, const RobotState& robot,
                                                     bool labelled)>
      see;
  double max_range_m = 0.0;
  Aabb map_bounds;     // W: whence something may come to the robot in time
  Aabb static_bounds;  // W: what stands outside is of no interest
  const Truth* truth = nullptr;
};

// Sets the stage's boxes from where its mission may lead.
void Surround(Stage& stage);

// Called after every frame with everything there is to show.
struct Moment {
  double time_s;
  uint64_t frame;
  const RobotState& robot;
  const Trajectory& plan;
  const Cycle* cycle;  // where one was begun at this frame
  std::string map;     // on the server; empty where nobody asks one
};
using Observer = std::function<void(const Moment&)>;

struct EpisodeResult {
  Row row = Row::kClearance;
  uint64_t seed = 0;
  Verdict verdict;
  std::vector<Cycle> cycles;
  std::vector<double> integrate_ms;
  double driven_s = 0.0;
  bool in_time = false;         // at the goal within twice the unobstructed time, unharmed
  double time_to_goal_s = 0.0;  // where in_time
  std::string outcome;          // in words
  std::string map_lost;         // when and why frames could not be integrated any more
};

struct EpisodeOptions {
  Row row = Row::kClearance;
  int plan_every = 2;  // frames
  PilotOptions pilot;
  Margins margins;
  Source source = Source::kMirror;
  double voxel_size_m = 0.25;
  double max_horizon_s = 6.5;
  Observer observer;
};

// Errors of frames, and of the server before the first one is integrated, end the drive. Later the
// map is lost, which slows the robot down and stops it; a collision is a result, too. The straight
// drive needs no client.
absl::StatusOr<EpisodeResult> RunEpisode(const Stage& stage, const client::EsdfClient* client,
                                         const EpisodeOptions& options);

}  // namespace clearance::demo
