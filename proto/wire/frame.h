// Frames: core <-> proto, with every structural check of the contract.
#pragma once

#include <string_view>

#include "absl/status/statusor.h"
#include "clearance/v1/ingest.pb.h"
#include "server/core/frame.h"

namespace clearance::wire {

// `source_id` and `max_range_m` of the result are the caller's to set: they come with the stream.
// Errors: INVALID_ARGUMENT naming the field below `field` (for example
// "frame.cloud.points_f32[417]"), index, got and expected.
absl::StatusOr<Frame> FrameFromProto(const v1::Frame& frame, const FrameLimits& limits = {},
                                     std::string_view field = "frame");
void ToProto(const Frame& frame, v1::Frame* out);

absl::StatusOr<ObjectMotion> MotionFromProto(const v1::ObjectMotion& motion,
                                             std::string_view field);
void ToProto(const ObjectMotion& motion, v1::ObjectMotion* out);

// The range limit of a stream: finite and not negative.
absl::StatusOr<double> MaxRangeFromProto(double max_range_m, std::string_view field);

void ToProto(const Violation& violation, v1::Violation* out);

}  // namespace clearance::wire
