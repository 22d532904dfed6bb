// One published revision of a map: immutable, shared by pointer, all that a query or a mirror needs.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/core/aabb.h"
#include "server/core/object_id.h"
#include "server/core/pose.h"
#include "server/map/distance_field.h"
#include "server/map/map_config.h"
#include "server/map/object_shape.h"

namespace clearance {

enum class LifeState : uint8_t { kTracked = 1, kCoasting = 2, kLost = 3, kRetired = 4 };

struct PoseStamp {
  int64_t stamp_ns = 0;
  Pose pose;
};

// An object at the view's stamp.
struct ObjectView {
  ObjectId id;
  uint32_t generation = 1;
  std::string class_name;
  std::string source_id;  // the source that owns the pose chain
  LifeState life_state = LifeState::kTracked;
  Pose T_W_L;
  Twist twist;            // smoothed over the last frames; W, at L's origin
  Screw screw_W;          // per second: H_W(s) = ExpScrew(s * screw_W); zero when unknown
  double position_sigma_m = 0;   // of the pose now
  double velocity_sigma_mps = 0; // growth of it with the horizon
  int64_t first_seen_ns = 0, last_seen_ns = 0;
  uint64_t observations = 0;  // frames with points
  std::shared_ptr<const ObjectShape> shape;
  std::shared_ptr<const std::vector<PoseStamp>> history;

  OrientedBox Box() const;  // of the observed surface, in W at the view's stamp
  // Pose `horizon_s` after the view's stamp, along the constant screw.
  Pose PoseAt(double horizon_s) const { return ExpScrew(screw_W * horizon_s) * T_W_L; }
};

// Built by query/ when a view is published: bounds that let a batch skip most objects.
struct ObjectIndex;

struct MapView {
  MapConfig config;
  uint64_t epoch = 0;
  uint64_t revision = 0;        // counts integrated frames and edits
  uint64_t field_revision = 0;  // newest revision that the field includes
  int64_t stamp_ns = 0;         // of the newest frame
  std::chrono::steady_clock::time_point published_at;
  DistanceField field;              // the static map's
  std::vector<ObjectView> objects;  // by id; retired ones last seen long ago included until evicted
  std::shared_ptr<const ObjectIndex> object_index;
  std::shared_ptr<const std::vector<PoseStamp>> sensor_path;
};

}  // namespace clearance
