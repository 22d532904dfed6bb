// Frames of a room with a box that drives through it, a second one that appears, is lost and comes
// back, and a camera that moves: what a map remembers of all kinds.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "server/core/frame.h"
#include "tests/testing/analytic_scene.h"

namespace clearance {

// Back and forth, so that it can go on for ever: 0, 1 ... 20, 19 ... 0.
inline int ScenePhase(int k) { return std::min(k % 40, 40 - k % 40); }

inline Frame MovingSceneFrame(int k, const std::string& source = "camera") {
  const int p = ScenePhase(k);
  using testing::AnalyticScene;
  using testing::Solid;
  const auto at = [](double x, double y, double z) {
    Pose pose = Pose::Identity();
    pose.translation() << x, y, z;
    return pose;
  };
  const Solid floor{Solid::Kind::kHalfSpace, at(0, 0, -1), Eigen::Vector3d::Ones(), 0};
  const Solid wall{Solid::Kind::kBox, at(0, 6, 1), Eigen::Vector3d(12, 0.5, 4), 0};
  const Solid crate{Solid::Kind::kBox, at(-2, 3, -0.5), Eigen::Vector3d(1, 1, 1), 0};
  std::vector<Solid> solids = {floor, wall, crate};
  solids.push_back({Solid::Kind::kBox, at(-1.5 + 0.15 * p, 4, -0.3), {1.2, 0.8, 1.2}, 7});
  const bool second = p >= 2 && (p < 6 || p >= 8);
  if (second) solids.push_back({Solid::Kind::kSphere, at(1.5, 3.0 - 0.1 * p, 0), {0.5, 0, 0}, 9});
  Frame frame;
  frame.frame_id = static_cast<uint64_t>(k) + 1;
  frame.stamp_ns = 1'000'000'000 + int64_t{k} * 100'000'000;
  frame.source_id = source;
  frame.T_W_X = testing::LookAt(Eigen::Vector3d(0.05 * p, -2, 0.5), Eigen::Vector3d(0, 4, 0));
  testing::Intrinsics camera;
  camera.width = 160;
  camera.height = 120;
  camera.fx = camera.fy = 80;
  camera.cx = 79.5;
  camera.cy = 59.5;
  frame.observation = AnalyticScene("moving", solids)
                          .RenderDepth(frame.T_W_X, camera, 0.004, static_cast<uint32_t>(k));
  const auto moved = [&](uint16_t id, const Eigen::Vector3d& step, const char* class_name) {
    ObjectMotion motion;
    motion.object_id = ObjectId(id);
    motion.pose.translation() = step;
    motion.class_name = class_name;
    frame.motions.push_back(motion);
  };
  const double step = k > 0 ? p - ScenePhase(k - 1) : 0;
  if (k > 0) moved(7, {0.15 * step, 0, 0}, "box");
  if (second && k > 2) moved(9, {0, -0.1 * step, 0}, "ball");
  return frame;
}

}  // namespace clearance
