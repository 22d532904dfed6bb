// CRC-32C (Castagnoli, reflected polynomial 0x82f63b78), as in iSCSI (RFC 3720, B.4): the checksum
// of log records, snapshot files and exported chunks.
#pragma once

#include <cstdint>
#include <string_view>

namespace clearance {

// Of `bytes`, or of `bytes` behind what has the checksum `crc`.
uint32_t Crc32c(std::string_view bytes, uint32_t crc = 0);

}  // namespace clearance
