// A progress line on a terminal; nothing elsewhere.
#pragma once

#include <cstdint>
#include <string>

#include "absl/time/time.h"

namespace clearance::cli {

class Progress {
 public:
  // `total` frames, of which `done` were there from the start.
  Progress(uint64_t total, uint64_t done, bool enabled);

  // At most a few times a second; `objects` alive, negative where not known.
  void Show(uint64_t done, int objects);
  // Clears the line, so that other output can follow.
  void Clear();

 private:
  const uint64_t total_, first_;
  const bool enabled_;
  const absl::Time start_;
  absl::Time last_;
};

// Whether standard error is a terminal.
bool IsTerminal();

// The line itself: bar, frames, frames/s, ETA, objects.
std::string ProgressLine(uint64_t done, uint64_t total, double frames_per_s, int objects);

}  // namespace clearance::cli
