// An object's state as watchers get it, exact to the bit.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "clearance/v1/watch.pb.h"
#include "server/core/object_id.h"
#include "server/core/pose.h"

namespace clearance::wire {

struct ObjectState {
  ObjectId id;
  uint32_t generation = 0;
  std::string class_name, source_id;
  v1::LifeState life_state = v1::LIFE_STATE_TRACKED;
  Pose T_W_L = Pose::Identity();
  Twist twist;
  Screw screw_W = Screw::Zero();
  double position_sigma_m = 0, velocity_sigma_mps = 0;
  int64_t first_seen_ns = 0, last_seen_ns = 0;
  uint64_t observations = 0;
};

// All but box, covariance and surface.
void ToProto(const ObjectState& state, v1::ObjectState* out);

// INVALID_ARGUMENT naming the field below `field`: an id that is none, an unknown life state,
// values that are not finite or absurdly large, a pose that is no rigid transform, negative
// deviations, lengths.
absl::StatusOr<ObjectState> ObjectStateFromProto(const v1::ObjectState& state,
                                                 std::string_view field);

}  // namespace clearance::wire
