#include "planner_demo/episode/sensor_rig.h"

#include <cmath>
#include <map>
#include <utility>

#include "planner_demo/sim/noise.h"
#include "planner_demo/sim/random.h"
#include "planner_demo/sim/simulator.h"

namespace clearance::demo {
namespace {

constexpr uint64_t kPoseStream = 77;

}  // namespace

SensorRig::SensorRig(sim::Scene scene, const RigNoise& noise, uint64_t seed)
    : scene_(std::move(scene)),
      noise_(noise),
      seed_(seed),
      directions_X_(sim::RayDirections(scene_.sensor)) {}

Frame SensorRig::See(uint64_t index, const Eigen::Isometry3d& T_W_X, bool labelled) const {
  const double time_s = TimeOf(index);
  sim::Scan scan = sim::CastScan(sim::SceneAt(scene_, time_s), scene_.sensor, directions_X_, T_W_X);
  sim::AddDepthNoise(noise_.range_m, sim::MaxRange(scene_.sensor), seed_, static_cast<int>(index),
                     scan);
  std::map<uint16_t, int> returns;
  for (const uint16_t label : scan.labels) ++returns[label];

  Frame frame;
  frame.frame_id = index;
  frame.stamp_ns = std::llround(time_s * 1e9);
  frame.T_W_X = T_W_X;
  PointCloud& cloud = frame.observation.emplace<PointCloud>();
  cloud.rows = static_cast<uint32_t>(scan.rows);
  cloud.columns = static_cast<uint32_t>(scan.columns);
  cloud.points_X.setZero(3, static_cast<Eigen::Index>(directions_X_.size()));
  cloud.labels.assign(directions_X_.size(), 0);
  for (size_t i = 0; i < directions_X_.size(); ++i) {
    const uint16_t label = scan.labels[i];
    if (scan.ranges_m[i] <= 0.0) continue;
    if (labelled && label != 0 && returns[label] < noise_.least_returns) continue;
    cloud.points_X.col(static_cast<Eigen::Index>(i)) =
        (scan.ranges_m[i] * directions_X_[i]).cast<float>();
    if (labelled) cloud.labels[i] = label;
  }
  if (!labelled) return frame;
  for (const sim::Mover& mover : scene_.movers) {
    const auto seen = returns.find(mover.id);
    if (seen == returns.end() || seen->second < noise_.least_returns) continue;
    ObjectMotion& motion = frame.motions.emplace_back();
    motion.object_id = ObjectId(mover.id);
    motion.kind = ObjectMotion::Kind::kWorldFromObject;
    motion.pose = mover.T_W_L(time_s);
    sim::Random random = sim::Random::ForItem(seed_, kPoseStream, index * 65536 + mover.id);
    for (int axis = 0; axis < 3; ++axis) {
      motion.pose.translation()[axis] += random.Normal(noise_.motion_m);
    }
    motion.class_name = mover.class_name;
  }
  return frame;
}

void LeaveOutFarStatic(const Aabb& near_W, Frame& frame) {
  auto* cloud = std::get_if<PointCloud>(&frame.observation);
  if (cloud == nullptr) return;
  const Eigen::Isometry3f T_W_X = frame.T_W_X.cast<float>();
  const Eigen::AlignedBox3f near = near_W.cast<float>();
  for (Eigen::Index i = 0; i < cloud->points_X.cols(); ++i) {
    const bool object = !cloud->labels.empty() && cloud->labels[static_cast<size_t>(i)] != 0;
    if (!object && !near.contains(T_W_X * cloud->points_X.col(i))) {
      cloud->points_X.col(i).setZero();
    }
  }
}

}  // namespace clearance::demo
