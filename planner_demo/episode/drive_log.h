// A drive in files, for pictures.
#pragma once

#include <fstream>
#include <string>

#include "absl/status/status.h"
#include "planner_demo/episode/episode.h"
#include "planner_demo/sim/scene.h"

namespace clearance::demo {

// Writes into a folder: drive.json (robot, mission, outcome), moments.jsonl (one line a frame: the
// robot, its plan, the map's objects with box and twist, the true objects' boxes) and slice_K.u8 of
// frames with a plan: rows by columns of bytes, the distance at 0.7 m height in cm up to 200, then
// as many states.
class DriveLog {
 public:
  // `scene` may be null: no true objects then. Errors of files and of the server come at Finish.
  DriveLog(const std::string& folder, const Stage& stage, const sim::Scene* scene);

  // To be called by the episode's observer; `client` as in the episode.
  void Add(const Moment& moment, const client::EsdfClient* client);
  absl::Status Finish(const EpisodeResult& result);

 private:
  void AddSlice(uint64_t frame, const client::EsdfClient& client, const std::string& map);

  const std::string folder_;
  const Stage& stage_;
  const sim::Scene* scene_;
  std::ofstream moments_;
  absl::Status status_;
};

}  // namespace clearance::demo
