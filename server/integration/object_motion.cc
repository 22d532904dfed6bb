#include "server/integration/object_motion.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

// Median |fused distance| at the object's points, were it at T_W_L; absent when hardly any point
// meets mapped surface.
std::optional<double> MedianResidual(const SurfaceMap& surface, const Pose& T_L_X,
                                     const Eigen::Matrix3Xf& points_X,
                                     const std::vector<uint32_t>& points) {
  constexpr size_t kSamples = 400;
  const size_t step = std::max<size_t>(1, points.size() / kSamples);
  std::vector<double> residuals;
  size_t samples = 0;
  for (size_t i = 0; i < points.size(); i += step, ++samples) {
    const Eigen::Vector3d p_L = T_L_X * points_X.col(points[i]).cast<double>();
    const VoxelIndex v = VoxelOf(p_L, surface.voxel_size_m());
    const float* weight = surface.WeightBlock(BlockOf(v));
    const int o = OffsetOf(v);
    if (weight && weight[o] > 0) residuals.push_back(std::abs(surface.MeanBlock(BlockOf(v))[o]));
  }
  if (residuals.size() * 2 < samples || residuals.empty()) return std::nullopt;
  std::nth_element(residuals.begin(), residuals.begin() + residuals.size() / 2, residuals.end());
  return residuals[residuals.size() / 2];
}

class ObjectFollower {
 public:
  ObjectFollower(const Frame& frame, const Eigen::Matrix3Xf& points_X, size_t min_points,
                 const WorldMap& map, std::vector<Violation>& violations)
      : frame_(frame),
        points_X_(points_X),
        min_points_(min_points),
        map_(map),
        previous_frame_(map.last_frame_id(frame.source_id)),
        violations_(violations) {}

  std::optional<ObjectTask> Follow(ObjectId id, const ObjectMotion* motion, int64_t motion_index,
                                   std::vector<uint32_t> points) {
    motion_ = motion;
    motion_index_ = motion_index;
    task_ = ObjectTask{};
    task_.update.id = id;
    task_.points = std::move(points);
    task_.update.observed = !task_.points.empty();
    if (motion_) task_.update.class_name = motion_->class_name;
    const auto it = map_.objects().find(id);
    if (it == map_.objects().end()) return FirstSight();
    const ObjectSubmap& object = it->second;
    if (object.source_id() != frame_.source_id && object.life_state() != LifeState::kLost) {
      if (motion_ || task_.update.observed) {
        Refuse(absl::StrFormat("object %d is followed by source '%s' until it is LOST", id.value(),
                               object.source_id()));
      }
      return std::nullopt;
    }
    return Known(object);
  }

 private:
  void Refuse(std::string why) {
    violations_.push_back({"motions", motion_index_, std::move(why)});
  }

  std::optional<ObjectTask> FirstSight() {
    if (task_.points.size() < min_points_) {
      if (motion_) {
        Refuse(absl::StrFormat(
            "object %d was never seen: a submap starts from labelled points, at least %d; got %d",
            task_.update.id.value(), min_points_, task_.points.size()));
      }
      return std::nullopt;
    }
    return Start();
  }

  // Paper Sec. III-D: a new object starts at the centroid of its first points, unrotated.
  ObjectTask Start() {
    task_.update.event = ObjectEvent::kCreated;
    task_.integrate = true;
    if (motion_ && motion_->kind == ObjectMotion::Kind::kWorldFromObject) {
      task_.update.T_W_L = Orthonormalized(motion_->pose);
      return std::move(task_);
    }
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (uint32_t i : task_.points) sum += points_X_.col(i).cast<double>();
    task_.update.T_W_L.translation() = frame_.T_W_X * (sum / task_.points.size()).eval();
    return std::move(task_);
  }

  ObjectTask Known(const ObjectSubmap& object) {
    const double period_s = (frame_.stamp_ns - object.pose_stamp_ns()) * 1e-9;
    if (motion_ && motion_->kind == ObjectMotion::Kind::kWorldFromObject) {
      task_.update.event = object.pose_frame_id() ? ObjectEvent::kMoved : ObjectEvent::kReanchored;
      Move(Orthonormalized(motion_->pose), object, period_s);
      return std::move(task_);
    }
    if (motion_ && ChainHolds(object)) {
      task_.update.event = ObjectEvent::kMoved;
      Move(Orthonormalized(motion_->pose * object.T_W_L()), object, period_s);
      return std::move(task_);
    }
    return Coast(object);
  }

  bool ChainHolds(const ObjectSubmap& object) {
    const std::optional<uint64_t> from =
        motion_->from_frame_id ? motion_->from_frame_id : previous_frame_;
    if (from && object.pose_frame_id() == from) return true;
    const auto name = [](const std::optional<uint64_t>& frame) {
      return frame ? absl::StrFormat("frame %d", *frame) : std::string("no frame");
    };
    Refuse(absl::StrFormat("motion of object %d starts at %s, but the object's pose is of %s",
                           task_.update.id.value(), name(from), name(object.pose_frame_id())));
    return false;
  }

  void Move(const Pose& T_W_L, const ObjectSubmap& object, double period_s) {
    task_.update.T_W_L = T_W_L;
    if (period_s > 0 && object.pose_frame_id()) {
      task_.update.H_W = T_W_L * object.T_W_L().inverse();
      task_.update.motion_period_s = period_s;
    }
    task_.integrate = task_.update.observed;
  }

  // The chain has a gap: constant twist, until the points fit the submap where it should be by now.
  ObjectTask Coast(const ObjectSubmap& object) {
    task_.update.event = ObjectEvent::kCoasted;
    task_.update.T_W_L = object.CoastedTo(frame_.stamp_ns);
    if (task_.points.size() < min_points_) return std::move(task_);
    const auto residual = MedianResidual(
        object.surface(), task_.update.T_W_L.inverse() * frame_.T_W_X, points_X_, task_.points);
    if (residual && *residual < map_.config().voxel_size_m) {
      task_.update.event = ObjectEvent::kReanchored;
      task_.integrate = true;
    } else if (motion_) {
      return Start();  // elsewhere, and followed again: a new generation
    }
    return std::move(task_);
  }

  const Frame& frame_;
  const Eigen::Matrix3Xf& points_X_;
  const size_t min_points_;
  const WorldMap& map_;
  const std::optional<uint64_t> previous_frame_;
  std::vector<Violation>& violations_;
  const ObjectMotion* motion_ = nullptr;
  int64_t motion_index_ = -1;
  ObjectTask task_;
};

}  // namespace

std::vector<ObjectTask> FollowObjects(const Frame& frame, const Eigen::Matrix3Xf& points_X,
                                      LabelledPoints labelled, size_t min_points,
                                      const WorldMap& map, std::vector<Violation>& violations) {
  struct Entry {
    const ObjectMotion* motion = nullptr;
    int64_t index = -1;
    std::vector<uint32_t> points;
  };
  std::map<ObjectId, Entry> entries;
  for (const auto& [id, object] : map.objects()) {
    if (object.source_id() == frame.source_id) entries[id];
  }
  for (size_t i = 0; i < frame.motions.size(); ++i) {
    Entry& e = entries[frame.motions[i].object_id];
    e.motion = &frame.motions[i];
    e.index = i;
  }
  for (auto& [id, points] : labelled) entries[id].points = std::move(points);
  ObjectFollower follower(frame, points_X, min_points, map, violations);
  std::vector<ObjectTask> tasks;
  for (auto& [id, e] : entries) {
    if (auto task = follower.Follow(id, e.motion, e.index, std::move(e.points))) {
      tasks.push_back(std::move(*task));
    }
  }
  return tasks;
}

}  // namespace clearance
