#include "client/cli/progress.h"

#include <unistd.h>

#include <cmath>
#include <iostream>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"

namespace clearance::cli {

bool IsTerminal() { return isatty(STDERR_FILENO) == 1; }

Progress::Progress(uint64_t total, uint64_t done, bool enabled)
    : total_(total),
      first_(done),
      enabled_(enabled),
      start_(absl::Now()),
      last_(absl::InfinitePast()) {}

void Progress::Show(uint64_t done, int objects) {
  const absl::Time now = absl::Now();
  if (!enabled_ || (now - last_ < absl::Milliseconds(150) && done < total_)) return;
  last_ = now;
  const double seconds = absl::ToDoubleSeconds(now - start_);
  const double rate = seconds > 0 ? static_cast<double>(done - first_) / seconds : 0;
  std::cerr << "\r\x1b[K" << ProgressLine(done, total_, rate, objects) << std::flush;
}

void Progress::Clear() {
  if (enabled_) std::cerr << "\r\x1b[K" << std::flush;
}

std::string ProgressLine(uint64_t done, uint64_t total, double frames_per_s, int objects) {
  constexpr int kWidth = 30;
  const double share = total > 0 ? static_cast<double>(done) / static_cast<double>(total) : 1;
  const int filled = static_cast<int>(std::lround(share * kWidth));
  std::string line(1, '[');
  line.append(filled, '#').append(kWidth - filled, '.').push_back(']');
  line += absl::StrFormat(" %d/%d  %.1f frames/s", done, total, frames_per_s);
  if (frames_per_s > 0) {
    line += absl::StrFormat("  ETA %.0f s", static_cast<double>(total - done) / frames_per_s);
  }
  if (objects >= 0) line += absl::StrFormat("  %d objects", objects);
  return line;
}

}  // namespace clearance::cli
