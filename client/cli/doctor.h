// The checks of `clearance doctor`, one by one.
#pragma once

#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/types.h"

namespace clearance::cli {

struct Finding {
  enum Level { kGood = 0, kWarning = 1, kBad = 2 };
  Level level = kGood;
  std::string what, text;
};

// A PEM certificate at `now`: bad where unreadable, expired or not valid yet, a warning where it
// expires within two weeks.
Finding CheckCertificate(const std::string& path, absl::Time now);
// A warning below 1 GiB or a twentieth.
Finding CheckDisk(const std::string& path);
// Versions, draining, and each map's rejected and dropped frames and its queue.
std::vector<Finding> CheckServer(const client::ServerInfo& info, const client::ServerStats& stats);

}  // namespace clearance::cli
