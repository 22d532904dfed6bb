#include "server/map/object_submap.h"

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

// Motions of the last moments are averaged: annotation and tracking jitter by centimetres a frame,
// and a planner extrapolates the twist over seconds.
constexpr double kTwistWindow_s = 0.6;
constexpr size_t kTwistSamples = 12;
// Without a second motion there is nothing to judge a velocity by.
constexpr double kUnjudgedVelocitySigma_mps = 0.5;
constexpr double kLeastVelocitySigma_mps = 0.02;

Eigen::Vector3d VelocityAt(const Screw& xi, const Eigen::Vector3d& p) {
  return xi.head<3>() + xi.tail<3>().cross(p);
}

}  // namespace

void AppendPose(std::vector<PoseStamp>& path, const PoseStamp& pose, size_t limit) {
  if (path.size() >= limit) {
    size_t kept = 0;
    for (size_t i = 0; i < path.size(); i += 2) path[kept++] = path[i];
    path.resize(kept);
  }
  path.push_back(pose);
}

void SavePath(const std::vector<PoseStamp>& path, ByteWriter* out) {
  out->Put<uint64_t>(path.size());
  for (const PoseStamp& p : path) {
    out->Put(p.stamp_ns);
    out->PutPose(p.pose);
  }
}

std::vector<PoseStamp> LoadPath(ByteReader* in) {
  std::vector<PoseStamp> path(in->GetCount(sizeof(int64_t) + sizeof(Eigen::Matrix4d)));
  for (PoseStamp& p : path) {
    p.stamp_ns = in->Get<int64_t>();
    p.pose = in->GetPose();
  }
  return path;
}

ObjectSubmap::ObjectSubmap(ObjectId id, uint32_t generation, double voxel_size_m,
                           std::string source_id)
    : id_(id),
      generation_(generation),
      source_id_(std::move(source_id)),
      history_(std::make_shared<std::vector<PoseStamp>>()),
      surface_(voxel_size_m) {}

Pose ObjectSubmap::CoastedTo(int64_t stamp_ns) const {
  const double s = (stamp_ns - pose_stamp_ns_) * 1e-9;
  if (s == 0 || screw_W_.isZero(0)) return T_W_L_;
  return Orthonormalized(ExpScrew(screw_W_ * s) * T_W_L_);
}

std::vector<BlockIndex> ObjectSubmap::Apply(const ObjectUpdate& update, const MapUpdate& frame,
                                            const FusionOptions& options) {
  if (!update.class_name.empty()) class_name_ = update.class_name;
  T_W_L_ = update.T_W_L;
  pose_stamp_ns_ = frame.stamp_ns;
  if (update.event == ObjectEvent::kCoasted) {
    pose_frame_id_.reset();
    recent_motions_.clear();  // the smoothed screw stays; samples across the gap would be wrong
  } else {
    pose_frame_id_ = frame.frame_id;
    pose_known_ns_ = frame.stamp_ns;
    source_id_ = frame.source_id;
  }
  if (update.H_W && update.motion_period_s > 0) {
    recent_motions_.push_back({frame.stamp_ns, update.motion_period_s, *update.H_W});
    SmoothMotion(frame.stamp_ns);
  }
  if (update.observed) {
    if (observations_ == 0) first_seen_ns_ = frame.stamp_ns;
    last_seen_ns_ = frame.stamp_ns;
    ++observations_;
  }
  auto history = std::make_shared<std::vector<PoseStamp>>(*history_);  // readers hold the old one
  AppendPose(*history, {frame.stamp_ns, T_W_L_}, kMaxHistoryPoses);
  history_ = std::move(history);
  return surface_.Apply(update.surface, options);
}

void ObjectSubmap::SmoothMotion(int64_t stamp_ns) {
  while (recent_motions_.size() > kTwistSamples ||
         (recent_motions_.size() > 1 &&
          (stamp_ns - recent_motions_.front().stamp_ns) * 1e-9 > kTwistWindow_s)) {
    recent_motions_.pop_front();
  }
  // Design, decision 7: a constant screw. Screws in W average without lag while a body turns.
  Screw sum = Screw::Zero();
  double time_s = 0;
  for (const MotionSample& m : recent_motions_) {
    sum += LogScrew(m.H_W);
    time_s += m.period_s;
  }
  screw_W_ = sum / time_s;
  const size_t n = recent_motions_.size();
  if (n < 2) {
    velocity_sigma_mps_ = kUnjudgedVelocitySigma_mps;
    return;
  }
  const Eigen::Vector3d p = T_W_L_.translation(), mean = VelocityAt(screw_W_, p);
  double squares = 0;
  for (const MotionSample& m : recent_motions_) {
    squares += (VelocityAt(LogScrew(m.H_W) / m.period_s, p) - mean).squaredNorm();
  }
  const double spread_mps = std::sqrt(squares / (3.0 * (n - 1)));
  velocity_sigma_mps_ = std::max(kLeastVelocitySigma_mps, spread_mps / std::sqrt(double(n)));
  position_sigma_m_ = spread_mps * time_s / n;
}

void ObjectSubmap::Age(int64_t stamp_ns, bool observed, const MapConfig& config) {
  const int64_t known_ns = std::max(pose_known_ns_, last_seen_ns_);
  const double unseen_s = (stamp_ns - known_ns) * 1e-9;
  if (unseen_s >= config.object_retired_after_s) {
    life_state_ = LifeState::kRetired;
  } else if (unseen_s >= config.object_lost_after_s) {
    life_state_ = LifeState::kLost;
  } else if (observed && pose_frame_id_) {
    life_state_ = LifeState::kTracked;
  } else if (stamp_ns > last_seen_ns_ || !pose_frame_id_) {
    life_state_ = LifeState::kCoasting;
  }
}

void ObjectSubmap::Save(ByteWriter* out) const {
  out->Put(id_.value());
  out->Put(generation_);
  out->PutText(source_id_);
  out->PutText(class_name_);
  out->Put(life_state_);
  out->PutPose(T_W_L_);
  out->Put<uint8_t>(pose_frame_id_.has_value());
  out->Put(pose_frame_id_.value_or(0));
  for (int64_t stamp_ns : {pose_stamp_ns_, first_seen_ns_, last_seen_ns_, pose_known_ns_}) {
    out->Put(stamp_ns);
  }
  out->Put(observations_);
  out->PutMatrix(screw_W_);
  out->Put(position_sigma_m_);
  out->Put(velocity_sigma_mps_);
  out->Put<uint64_t>(recent_motions_.size());
  for (const MotionSample& m : recent_motions_) {
    out->Put(m.stamp_ns);
    out->Put(m.period_s);
    out->PutPose(m.H_W);
  }
  SavePath(*history_, out);
}

ObjectSubmap ObjectSubmap::Load(ByteReader* in, SurfaceMap surface) {
  const ObjectId id(in->Get<uint16_t>());
  const uint32_t generation = in->Get<uint32_t>();
  ObjectSubmap object(id, generation, surface.voxel_size_m(), std::string(in->GetText()));
  object.class_name_ = std::string(in->GetText());
  object.life_state_ = in->Get<LifeState>();
  object.T_W_L_ = in->GetPose();
  const bool has_pose_frame = in->Get<uint8_t>() != 0;
  const uint64_t pose_frame_id = in->Get<uint64_t>();
  if (has_pose_frame) object.pose_frame_id_ = pose_frame_id;
  for (int64_t* stamp_ns : {&object.pose_stamp_ns_, &object.first_seen_ns_, &object.last_seen_ns_,
                            &object.pose_known_ns_}) {
    *stamp_ns = in->Get<int64_t>();
  }
  object.observations_ = in->Get<uint64_t>();
  in->GetMatrix(object.screw_W_);
  object.position_sigma_m_ = in->Get<double>();
  object.velocity_sigma_mps_ = in->Get<double>();
  for (size_t left = in->GetCount(sizeof(int64_t)); left > 0 && in->ok(); --left) {
    MotionSample m;
    m.stamp_ns = in->Get<int64_t>();
    m.period_s = in->Get<double>();
    m.H_W = in->GetPose();
    object.recent_motions_.push_back(m);
  }
  object.history_ = std::make_shared<const std::vector<PoseStamp>>(LoadPath(in));
  object.surface_ = std::move(surface);
  return object;
}

ObjectView ObjectSubmap::View(int64_t stamp_ns) const {
  ObjectView view;
  view.id = id_;
  view.generation = generation_;
  view.class_name = class_name_;
  view.source_id = source_id_;
  view.life_state = life_state_;
  view.T_W_L = life_state_ == LifeState::kRetired ? T_W_L_ : CoastedTo(stamp_ns);
  view.screw_W = life_state_ == LifeState::kRetired ? Screw::Zero().eval() : screw_W_;
  view.twist = {VelocityAt(view.screw_W, view.T_W_L.translation()), view.screw_W.tail<3>()};
  view.position_sigma_m = position_sigma_m_;
  view.velocity_sigma_mps = velocity_sigma_mps_;
  view.first_seen_ns = first_seen_ns_;
  view.last_seen_ns = last_seen_ns_;
  view.observations = observations_;
  view.history = history_;
  return view;
}

}  // namespace clearance
