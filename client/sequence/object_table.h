// object_motions.csv and objects.csv: how labelled objects move, and what they are.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "proto/wire/frame.h"

namespace clearance::client {

// Motions by frame index; each moves world points from frame - 1 to frame (the paper's H).
using MotionTable = std::map<uint64_t, std::vector<ObjectMotion>>;

// DATA_LOSS naming file and line: columns other than frame, object_id, tx, ty, tz, qx, qy, qz, qw,
// an id outside 1..65535, a frame below 1, two motions of one object in one frame.
absl::StatusOr<MotionTable> ReadObjectMotions(const std::filesystem::path& path);

// Class names by object id, from the columns object_id and class; other columns are not read.
absl::StatusOr<std::map<ObjectId, std::string>> ReadClassNames(const std::filesystem::path& path);

}  // namespace clearance::client
