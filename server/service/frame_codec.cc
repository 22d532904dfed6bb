#include "server/service/frame_codec.h"

#include <limits>

#include "proto/wire/frame.h"

namespace clearance {
namespace {

absl::StatusOr<Frame> Decode(std::string_view bytes) {
  v1::IngestFrameRequest request;
  if (!request.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return absl::DataLossError("not an IngestFrameRequest");
  }
  // Whatever the limits are today: this frame was accepted.
  FrameLimits limits;
  limits.max_points = limits.max_motions = std::numeric_limits<size_t>::max();
  absl::StatusOr<Frame> frame = wire::FrameFromProto(request.frame(), limits);
  if (!frame.ok()) return frame.status();
  frame->source_id = request.source_id();
  frame->max_range_m = request.max_range_m();
  return frame;
}

absl::StatusOr<std::string> WithoutPoints(std::string_view bytes) {
  v1::IngestFrameRequest request;
  if (!request.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return absl::DataLossError("not an IngestFrameRequest");
  }
  request.mutable_frame()->clear_observation();
  return request.SerializeAsString();
}

}  // namespace

std::string EncodeFrameForLog(const v1::Frame& frame, const std::string& source,
                              double max_range_m) {
  v1::IngestFrameRequest request;
  request.set_source_id(source);
  request.set_max_range_m(max_range_m);
  // Lent, not copied: frames are large. It is not changed and taken back below.
  request.unsafe_arena_set_allocated_frame(const_cast<v1::Frame*>(&frame));
  std::string bytes = request.SerializeAsString();
  request.unsafe_arena_release_frame();
  return bytes;
}

FrameCodec WireFrameCodec() { return {Decode, WithoutPoints}; }

}  // namespace clearance
