// Rates between two looks at a server's counters.
#pragma once

#include <chrono>
#include <map>
#include <string>

#include "client/types.h"

namespace clearance::cli {

class Rates {
 public:
  using Clock = std::chrono::steady_clock;

  // The first look gives averages since the server's start. A counter that fell (the server was
  // started anew) counts from zero.
  void Take(const client::ServerStats& stats, Clock::time_point now = Clock::now());
  // Per second: of "map NAME" frames settled, of "call NAME" calls; 0 for what is not there.
  double Of(const std::string& name) const;

 private:
  std::map<std::string, uint64_t> counts_;
  std::map<std::string, double> rates_;
  Clock::time_point at_;
  bool any_ = false;
};

}  // namespace clearance::cli
