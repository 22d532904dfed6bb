// The layout of one segment file of the log, and what a reader finds in it.
//
// Header (40 bytes): "CLRLOG01", format version u32, 0 u32, lineage u64, first index u64, 0 u32,
// CRC-32C of the 36 bytes before. Then records: "CLRR", payload bytes u32, index u64, CRC-32C of
// the payload u32, CRC-32C of the 20 bytes before, payload. Little-endian.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace clearance {

inline constexpr size_t kSegmentHeaderBytes = 40, kRecordHeaderBytes = 24;

std::string SegmentHeader(uint64_t lineage, uint64_t first_index);
// Of a record whose payload, `head` and `body`, follows.
std::string RecordHeader(uint64_t index, std::string_view head, std::string_view body);

// Where a scan of a segment stopped, and why.
struct SegmentScan {
  enum class End {
    kClean,    // behind a whole record, at the end of the file
    kTorn,     // in a record that was never written to its end: the process or the machine stopped
    kDamaged,  // at bytes that no stop leaves behind
  };
  End end = End::kClean;
  uint64_t valid_bytes = 0;  // up to the end of the last good record
  uint64_t next_index = 0;   // behind the last good record
  std::string why;           // not kClean
};

// Calls `visit(index, payload)` for each good record of a segment that starts with `first_index`;
// stops at the first error of `visit`. DATA_LOSS where the header is not that of this segment,
// FAILED_PRECONDITION where it was written by a newer version.
using RecordVisitor = std::function<absl::Status(uint64_t index, std::string_view payload)>;
absl::StatusOr<SegmentScan> ScanSegment(std::string_view bytes, uint64_t lineage,
                                        uint64_t first_index, const RecordVisitor& visit);

}  // namespace clearance
