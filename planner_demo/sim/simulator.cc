#include "planner_demo/sim/simulator.h"

#include <utility>

namespace clearance::sim {

RayCaster SceneAt(const Scene& scene, double time_s) {
  RayCaster caster;
  caster.Add(scene.static_solids, Eigen::Isometry3d::Identity(), 0);
  for (const Mover& mover : scene.movers) caster.Add(mover.solids, mover.T_W_L(time_s), mover.id);
  caster.Build();
  return caster;
}

Simulator::Simulator(Scene scene, const NoiseOptions& noise, uint64_t seed)
    : scene_(std::move(scene)),
      noise_(noise),
      seed_(seed),
      directions_X_(RayDirections(scene_.sensor)) {}

SimulatedFrame Simulator::Next() {
  SimulatedFrame frame;
  frame.frame = next_frame_++;
  frame.time_s = TimeOf(frame.frame);
  frame.T_W_X = scene_.T_W_X(frame.time_s);
  frame.scan = CastScan(SceneAt(scene_, frame.time_s), scene_.sensor, directions_X_, frame.T_W_X);
  for (const uint16_t label : frame.scan.labels) {
    if (label != 0) ++frame.true_pixels[label];
  }
  for (const auto& [id, pixels] : frame.true_pixels) ++frames_in_view_[id];

  const bool wraps = std::holds_alternative<Lidar>(scene_.sensor);
  HideLateLabels(frame);
  ShrinkLabels(noise_.label_shrink_px, wraps, frame.scan);
  GrowLabels(noise_.label_grow_px, wraps, frame.scan);
  AddDepthNoise(noise_.depth_sigma_m, MaxRange(scene_.sensor), seed_, frame.frame, frame.scan);
  AddMotions(frame);
  known_.insert(frame.scan.labels.begin(), frame.scan.labels.end());
  return frame;
}

void Simulator::HideLateLabels(SimulatedFrame& frame) {
  for (uint16_t& label : frame.scan.labels) {
    if (label != 0 && frames_in_view_[label] <= noise_.late_label_frames) label = 0;
  }
}

void Simulator::AddMotions(SimulatedFrame& frame) const {
  for (const Mover& mover : scene_.movers) {
    if (!known_.contains(mover.id)) continue;
    const Eigen::Isometry3d T_W_L = mover.T_W_L(frame.time_s);
    const Eigen::Isometry3d H_W = T_W_L * mover.T_W_L(TimeOf(frame.frame - 1)).inverse();
    frame.motions.push_back(
        {mover.id, AddMotionNoise(H_W, T_W_L.translation(), noise_.motion_sigma_m, seed_, mover.id,
                                  frame.frame)});
  }
}

}  // namespace clearance::sim
