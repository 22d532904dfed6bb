// Driving through a recorded crossing: its frames go to the server, its truth judges.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "client/sequence/sequence.h"
#include "planner_demo/episode/episode.h"

namespace clearance::demo {

class Recording {
 public:
  // A folder like clearance_sim writes it, with gt/. NOT_FOUND, DATA_LOSS naming the file.
  static absl::StatusOr<std::unique_ptr<Recording>> Open(const std::string& folder);

  // Variant `index` of a drive over one road at the crossing in its middle: from one of four
  // corners to the next, starting ever later; recordings are too short for more. When the frames
  // end the robot finishes what it planned last, judged by where the objects really went. The
  // recording must outlive the stage.
  Stage StageFor(uint64_t index) const;

 private:
  Recording(client::Sequence sequence, std::unique_ptr<Truth> truth)
      : sequence_(std::move(sequence)), truth_(std::move(truth)) {}

  client::Sequence sequence_;
  std::unique_ptr<Truth> truth_;
};

}  // namespace clearance::demo
