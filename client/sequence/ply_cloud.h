// A labelled point cloud from a binary PLY file.
#pragma once

#include <filesystem>
#include <string_view>

#include "absl/status/statusor.h"
#include "proto/wire/frame.h"

namespace clearance::client {

// Vertex properties x, y, z (float or double) and, where there is one, label (any integer type);
// others are skipped. Binary little-endian. DATA_LOSS naming file and header line or byte where the
// file is something else, ends early, holds a coordinate that is not finite or a label outside
// 0..65535.
absl::StatusOr<PointCloud> ReadPlyCloud(const std::filesystem::path& path);
absl::StatusOr<PointCloud> ParsePlyCloud(std::string_view bytes, const std::filesystem::path& path);

}  // namespace clearance::client
