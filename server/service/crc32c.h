// CRC-32C (Castagnoli, reflected polynomial 0x82f63b78), as in iSCSI (RFC 3720, B.4).
#pragma once

#include <cstdint>
#include <string_view>

namespace clearance {

uint32_t Crc32c(std::string_view bytes);

}  // namespace clearance
