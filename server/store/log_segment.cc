#include "server/store/log_segment.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "server/core/bytes.h"
#include "server/core/crc32c.h"

namespace clearance {
namespace {

constexpr char kSegmentMagic[] = "CLRLOG01", kRecordMagic[] = "CLRR";
constexpr uint32_t kVersion = 1;
// A file system may extend a file before it writes the data: zeros then stand where it would be.
constexpr size_t kSectorBytes = 512;

bool AllZero(std::string_view bytes) {
  return std::all_of(bytes.begin(), bytes.end(), [](char c) { return c == 0; });
}

bool EndsInZeros(std::string_view payload) {
  return !payload.empty() &&
         AllZero(payload.substr(payload.size() - std::min(payload.size(), kSectorBytes)));
}

absl::Status CheckHeader(std::string_view bytes, uint64_t lineage, uint64_t first_index) {
  ByteReader in(bytes, "segment header");
  char magic[8];
  in.GetRaw(magic, sizeof(magic));
  const uint32_t version = in.Get<uint32_t>();
  in.Get<uint32_t>();
  const uint64_t its_lineage = in.Get<uint64_t>(), its_first = in.Get<uint64_t>();
  in.Get<uint32_t>();
  const uint32_t crc = in.Get<uint32_t>();
  if (!in.ok()) return in.Error("ends too early");
  if (std::string_view(magic, 8) != kSegmentMagic) return in.Error("no segment of a frame log");
  if (version > kVersion) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "segment header: format version %d, this server knows up to %d", version, kVersion));
  }
  if (crc != Crc32c(bytes.substr(0, kSegmentHeaderBytes - 4))) return in.Error("wrong checksum");
  if (its_lineage != lineage || its_first != first_index) {
    return in.Error(absl::StrFormat("of log %x at record %d, expected log %x at record %d",
                                    its_lineage, its_first, lineage, first_index));
  }
  return absl::OkStatus();
}

}  // namespace

std::string SegmentHeader(uint64_t lineage, uint64_t first_index) {
  ByteWriter out;
  out.PutRaw(kSegmentMagic, 8);
  out.Put(kVersion);
  out.Put<uint32_t>(0);
  out.Put(lineage);
  out.Put(first_index);
  out.Put<uint32_t>(0);
  std::string header = out.Take();
  const uint32_t crc = Crc32c(header);
  header.append(reinterpret_cast<const char*>(&crc), sizeof(crc));
  return header;
}

std::string RecordHeader(uint64_t index, std::string_view head, std::string_view body) {
  ByteWriter out;
  out.PutRaw(kRecordMagic, 4);
  out.Put(static_cast<uint32_t>(head.size() + body.size()));
  out.Put(index);
  out.Put(Crc32c(body, Crc32c(head)));
  std::string header = out.Take();
  const uint32_t crc = Crc32c(header);
  header.append(reinterpret_cast<const char*>(&crc), sizeof(crc));
  return header;
}

absl::StatusOr<SegmentScan> ScanSegment(std::string_view bytes, uint64_t lineage,
                                        uint64_t first_index, const RecordVisitor& visit) {
  if (absl::Status s = CheckHeader(bytes, lineage, first_index); !s.ok()) return s;
  SegmentScan scan;
  scan.next_index = first_index;
  scan.valid_bytes = kSegmentHeaderBytes;
  const auto stop = [&scan](SegmentScan::End end, std::string why) {
    scan.end = end;
    scan.why = absl::StrFormat("record %d at byte %d %s", scan.next_index, scan.valid_bytes, why);
    return scan;
  };
  while (scan.valid_bytes < bytes.size()) {
    const std::string_view rest = bytes.substr(scan.valid_bytes);
    if (rest.size() < kRecordHeaderBytes) return stop(SegmentScan::End::kTorn, "is incomplete");
    ByteReader in(rest.substr(0, kRecordHeaderBytes), "record");
    char magic[4];
    in.GetRaw(magic, sizeof(magic));
    const uint32_t size = in.Get<uint32_t>();
    const uint64_t index = in.Get<uint64_t>();
    const uint32_t payload_crc = in.Get<uint32_t>(), header_crc = in.Get<uint32_t>();
    if (std::string_view(magic, 4) != kRecordMagic ||
        header_crc != Crc32c(rest.substr(0, kRecordHeaderBytes - 4))) {
      if (AllZero(rest)) return stop(SegmentScan::End::kTorn, "was never written");
      return stop(SegmentScan::End::kDamaged, "has a damaged header");
    }
    if (index != scan.next_index) {
      return stop(SegmentScan::End::kDamaged, absl::StrFormat("is followed by record %d", index));
    }
    if (rest.size() - kRecordHeaderBytes < size) {
      return stop(SegmentScan::End::kTorn, "is incomplete");
    }
    const std::string_view payload = rest.substr(kRecordHeaderBytes, size);
    if (payload_crc != Crc32c(payload)) {
      const bool last = rest.size() == kRecordHeaderBytes + size;
      return last && EndsInZeros(payload)
                 ? stop(SegmentScan::End::kTorn, "was not written to its end")
                 : stop(SegmentScan::End::kDamaged, "has a wrong checksum");
    }
    if (absl::Status s = visit(index, payload); !s.ok()) return s;
    scan.valid_bytes += kRecordHeaderBytes + size;
    ++scan.next_index;
  }
  return scan;
}

}  // namespace clearance
