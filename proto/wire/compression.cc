#include "proto/wire/compression.h"

#include <zstd.h>

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

constexpr size_t kWorthCompressing = 256;
constexpr int kLevel = 1;  // speed: deltas are made on the way to a planner

}  // namespace

Payload PackPayload(std::string bytes) {
  Payload payload;
  payload.payload_bytes = bytes.size();
  if (bytes.size() >= kWorthCompressing) {
    std::string packed(ZSTD_compressBound(bytes.size()), '\0');
    const size_t size =
        ZSTD_compress(packed.data(), packed.size(), bytes.data(), bytes.size(), kLevel);
    if (!ZSTD_isError(size) && size < bytes.size()) {
      packed.resize(size);
      payload.bytes = std::move(packed);
      payload.compression = v1::COMPRESSION_ZSTD;
      return payload;
    }
  }
  payload.bytes = std::move(bytes);
  return payload;
}

absl::StatusOr<std::string> UnpackPayload(std::string_view bytes, int compression,
                                          uint64_t payload_bytes, std::string_view field) {
  if (payload_bytes > kMaxPayloadBytes) {
    return absl::DataLossError(absl::StrFormat("%s: %d bytes uncompressed, limit %d", field,
                                               payload_bytes, kMaxPayloadBytes));
  }
  const auto wrong_size = [&](size_t got) {
    return absl::DataLossError(absl::StrFormat("%s: got %d bytes uncompressed, %d were announced",
                                               field, got, payload_bytes));
  };
  if (compression == v1::COMPRESSION_UNSPECIFIED) {
    if (bytes.size() != payload_bytes) return wrong_size(bytes.size());
    return std::string(bytes);
  }
  if (compression != v1::COMPRESSION_ZSTD) {
    return InvalidField(field, -1, absl::StrFormat("compression %d", compression),
                        "COMPRESSION_UNSPECIFIED or COMPRESSION_ZSTD");
  }
  std::string unpacked(payload_bytes, '\0');
  const size_t size = ZSTD_decompress(unpacked.data(), unpacked.size(), bytes.data(), bytes.size());
  if (ZSTD_isError(size)) {
    return absl::DataLossError(absl::StrFormat("%s: %s", field, ZSTD_getErrorName(size)));
  }
  if (size != payload_bytes) return wrong_size(size);
  return unpacked;
}

}  // namespace clearance::wire
