// CRC-32C (Castagnoli), the checksum of exported chunks.
#pragma once

#include <cstdint>
#include <string_view>

namespace clearance::wire {

uint32_t Crc32c(std::string_view bytes);

}  // namespace clearance::wire
