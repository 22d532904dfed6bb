// Payloads that may travel compressed.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "clearance/v1/watch.pb.h"

namespace clearance::wire {

// No payload grows larger than this when it is unpacked.
inline constexpr uint64_t kMaxPayloadBytes = 16u << 20;

struct Payload {
  std::string bytes;  // as they travel
  v1::Compression compression = v1::COMPRESSION_UNSPECIFIED;
  uint64_t payload_bytes = 0;  // uncompressed
};

// Compressed where that makes it smaller; short ones stay as they are.
Payload PackPayload(std::string bytes);

// DATA_LOSS naming `field` where the bytes are damaged, are not `payload_bytes` long when unpacked,
// or ask for more than kMaxPayloadBytes; INVALID_ARGUMENT for an unknown compression.
absl::StatusOr<std::string> UnpackPayload(std::string_view bytes, int compression,
                                          uint64_t payload_bytes, std::string_view field);

}  // namespace clearance::wire
