// trajectory.tum: timestamp tx ty tz qx qy qz qw, one line a frame.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "absl/status/statusor.h"
#include "proto/wire/geometry.h"

namespace clearance::client {

struct SensorPath {
  std::vector<int64_t> stamps_ns;  // strictly rising
  std::vector<Pose> T_W_X;
};

// DATA_LOSS naming file and line for anything but eight numbers, a stamp that does not rise or a
// quaternion that is not of unit length (within 1e-3).
absl::StatusOr<SensorPath> ReadTrajectory(const std::filesystem::path& path);

// A pose from seven cells tx ty tz qx qy qz qw; `error` says what is wrong.
bool ParsePose(const std::string_view* cells, Pose* pose, std::string* error);

}  // namespace clearance::client
