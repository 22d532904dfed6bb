// 16-bit grey PNG images: depth and labels.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace clearance::client {

struct Gray16Image {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<uint16_t> pixels;  // row by row
};

// 8-bit grey images widen. DATA_LOSS naming file and byte where the file is not a PNG, of another
// kind, larger than 2^26 pixels, truncated or corrupt.
absl::StatusOr<Gray16Image> ReadGray16Png(const std::filesystem::path& path);
absl::StatusOr<Gray16Image> ParseGray16Png(std::string_view bytes,
                                           const std::filesystem::path& path);

}  // namespace clearance::client
