// One moving rigid object: its surface in its own frame L and the chain of its poses.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/core/bytes.h"
#include "server/core/object_id.h"
#include "server/core/pose.h"
#include "server/map/map_config.h"
#include "server/map/map_update.h"
#include "server/map/map_view.h"
#include "server/map/surface_map.h"

namespace clearance {

// Appends to a path of bounded length: a full path loses every second pose, so that it still spans
// all.
void AppendPose(std::vector<PoseStamp>& path, const PoseStamp& pose, size_t limit);
inline constexpr size_t kMaxHistoryPoses = 1024;
void SavePath(const std::vector<PoseStamp>& path, ByteWriter* out);
std::vector<PoseStamp> LoadPath(ByteReader* in);

// The paper's R^j with its pose chain and life cycle. Moving it changes one pose and no voxel.
// Not thread-safe: owned by the mapping thread.
class ObjectSubmap {
 public:
  ObjectSubmap(ObjectId id, uint32_t generation, double voxel_size_m, std::string source_id);

  ObjectId id() const { return id_; }
  uint32_t generation() const { return generation_; }
  const std::string& source_id() const { return source_id_; }  // the source that owns the chain
  const std::string& class_name() const { return class_name_; }
  LifeState life_state() const { return life_state_; }
  const Pose& T_W_L() const { return T_W_L_; }
  // Frame of the pose above: a motion must start here. Absent while coasting (the chain has a gap).
  std::optional<uint64_t> pose_frame_id() const { return pose_frame_id_; }
  int64_t pose_stamp_ns() const { return pose_stamp_ns_; }
  int64_t last_seen_ns() const { return last_seen_ns_; }
  uint64_t observations() const { return observations_; }
  const SurfaceMap& surface() const { return surface_; }
  const Screw& screw_W() const { return screw_W_; }  // per second, smoothed
  // Pose at a later stamp at constant screw.
  Pose CoastedTo(int64_t stamp_ns) const;

  // Applies this frame's update. Returns the blocks of L whose surface changed (empty on pure
  // motion).
  std::vector<BlockIndex> Apply(const ObjectUpdate& update, const MapUpdate& frame,
                                const FusionOptions& options);
  // Life cycle by frame stamps: TRACKED -> COASTING -> LOST -> RETIRED.
  void Age(int64_t stamp_ns, bool observed, const MapConfig& config);
  void Retire() { life_state_ = LifeState::kRetired; }
  // For snapshots: everything but the surface, exactly.
  void Save(ByteWriter* out) const;
  static ObjectSubmap Load(ByteReader* in, SurfaceMap surface);

  // All but the shape, which the publisher derives from surface().
  ObjectView View(int64_t stamp_ns) const;

 private:
  void SmoothMotion(int64_t stamp_ns);

  ObjectId id_;
  uint32_t generation_;
  std::string source_id_, class_name_;
  LifeState life_state_ = LifeState::kTracked;
  Pose T_W_L_ = Pose::Identity();
  std::optional<uint64_t> pose_frame_id_;
  int64_t pose_stamp_ns_ = 0;
  int64_t first_seen_ns_ = 0, last_seen_ns_ = 0;
  int64_t pose_known_ns_ = 0;  // newest frame that told the pose
  uint64_t observations_ = 0;
  Screw screw_W_ = Screw::Zero();
  double position_sigma_m_ = 0, velocity_sigma_mps_ = 0;
  struct MotionSample {
    int64_t stamp_ns;
    double period_s;
    Pose H_W;
  };
  std::deque<MotionSample> recent_motions_;
  std::shared_ptr<const std::vector<PoseStamp>> history_;
  SurfaceMap surface_;
};

}  // namespace clearance
