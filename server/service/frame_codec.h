// Frames as the log holds them: IngestFrameRequest messages.
#pragma once

#include <string>

#include "clearance/v1/ingest.pb.h"
#include "server/engine/log_record.h"

namespace clearance {

// As it came over the wire, so that replaying it decodes the same numbers.
std::string EncodeFrameForLog(const v1::Frame& frame, const std::string& source,
                              double max_range_m);
FrameCodec WireFrameCodec();

}  // namespace clearance
