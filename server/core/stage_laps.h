// How long the steps of a frame take.
#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace clearance {

// Durations of steps, milliseconds, in the order in which they ended.
using StageTimes = std::vector<std::pair<std::string, double>>;

// A clock in milliseconds from an arbitrary start. Benchmarks on busy machines put the process' CPU
// time here.
using StageClock = double (*)();

inline double WallMs() {
  return std::chrono::duration<double, std::milli>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

// Not thread-safe.
class StageLaps {
 public:
  explicit StageLaps(StageTimes* out, StageClock clock = WallMs)
      : out_(out), clock_(clock), started_(clock()), last_(started_) {}

  // Appends the time since the last lap under a name.
  double Lap(const char* stage) {
    const double now = clock_(), ms = now - last_;
    last_ = now;
    out_->emplace_back(stage, ms);
    return ms;
  }
  // Appends the time since this object was made; for stages that others are part of.
  void Whole(const char* stage) { out_->emplace_back(stage, clock_() - started_); }
  void Append(const char* stage, double ms) { out_->emplace_back(stage, ms); }

 private:
  StageTimes* out_;
  StageClock clock_;
  double started_, last_;
};

}  // namespace clearance
