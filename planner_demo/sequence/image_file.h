#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <string>
#include <vector>

namespace clearance::sim {

// Writes a 16 bit grey PNG; `pixels` row by row, width * height of them.
absl::Status WritePng16(const std::string& path, int width, int height,
                        const std::vector<uint16_t>& pixels);

}  // namespace clearance::sim
