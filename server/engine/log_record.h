// What a map's log holds: everything that changes the map or settles a frame, in order.
#pragma once

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/engine/map_model.h"

namespace clearance {

// How frames are encoded is the transport's business.
struct FrameCodec {
  std::function<absl::StatusOr<Frame>(std::string_view)> decode;
  // The same frame without points: what the overload policy leaves of it.
  std::function<absl::StatusOr<std::string>(std::string_view)> without_points;
};

struct LogRecord {
  enum class Kind : uint8_t {
    kFrame = 1,     // integrated, or refused by the integrator, again alike
    kStripped = 2,  // lost its points to the overload policy
    kRejected = 3,  // settled without reaching the map
    kEdit = 4,
    kEviction = 5,
  };
  Kind kind = Kind::kFrame;
  std::string_view frame;  // kFrame, kStripped: encoded; points into the record
  std::string source_id;   // kRejected
  uint64_t frame_id = 0;
  RegionEdit edit;
  MapModel::Eviction eviction;
};

// Of a frame record this is the head; the encoded frame follows as its body.
std::string EncodeHead(const LogRecord& record);
// DATA_LOSS for bytes of another kind.
absl::StatusOr<LogRecord> DecodeRecord(std::string_view bytes);

}  // namespace clearance
