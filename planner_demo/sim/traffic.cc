#include "planner_demo/sim/traffic.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace clearance::sim {

Traffic::Traffic(Scene& scene, double duration_s, double margin_m, double sensor_margin_m)
    : scene_(scene), margin_m_(margin_m), sensor_margin_m_(sensor_margin_m) {
  constexpr double kStep = 0.1;
  for (double t = 0.0; t < duration_s + kStep; t += kStep) times_s_.push_back(t);
}

bool Traffic::TryAdd(Body body, const PoseFunction& T_W_L) {
  const int discs = static_cast<int>(std::ceil(body.half_length_m / body.half_width_m));
  const double half_step_m = body.half_length_m / discs;
  Track track{std::hypot(half_step_m, body.half_width_m), discs, {}};
  for (const double t : times_s_) {
    const Eigen::Isometry3d pose = T_W_L(t);
    for (int i = 0; i < discs; ++i) {
      const double x = -body.half_length_m + (2 * i + 1) * half_step_m;
      track.discs_W.emplace_back((pose * Eigen::Vector3d(x, 0.0, 0.0)).head<2>());
    }
  }
  for (size_t i = 0; i < track.discs_W.size(); ++i) {
    const Eigen::Vector2d eye = scene_.T_W_X(times_s_[i / discs]).translation().head<2>();
    if ((track.discs_W[i] - eye).norm() < track.radius_m + sensor_margin_m_) return false;
  }
  for (const Track& other : tracks_) {
    if (!ClearOfTrack(track, other)) return false;
  }
  if (!ClearOfStatic(track)) return false;
  tracks_.push_back(std::move(track));
  scene_.movers.push_back({static_cast<uint16_t>(scene_.movers.size() + 1), body.class_name,
                           std::move(body.solids), T_W_L});
  return true;
}

bool Traffic::ClearOfTrack(const Track& a, const Track& b) const {
  const double least_m = a.radius_m + b.radius_m + margin_m_;
  for (size_t k = 0; k < times_s_.size(); ++k) {
    for (int i = 0; i < a.discs_per_time; ++i) {
      for (int j = 0; j < b.discs_per_time; ++j) {
        const Eigen::Vector2d gap =
            a.discs_W[k * a.discs_per_time + i] - b.discs_W[k * b.discs_per_time + j];
        if (gap.norm() < least_m) return false;
      }
    }
  }
  return true;
}

bool Traffic::ClearOfStatic(const Track& track) const {
  const double least_m = track.radius_m + margin_m_;
  for (const Solid& solid : scene_.static_solids) {
    const Eigen::AlignedBox3d box = Bounds(solid);
    if (box.max().z() < 0.3 || box.min().z() > 2.0) continue;
    for (const Eigen::Vector2d& disc : track.discs_W) {
      const Eigen::Vector2d beyond =
          (box.min().head<2>() - disc).cwiseMax(disc - box.max().head<2>()).cwiseMax(0.0);
      if (beyond.norm() < least_m) return false;
    }
  }
  return true;
}

}  // namespace clearance::sim
