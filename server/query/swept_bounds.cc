#include "server/query/swept_bounds.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/query/lanes.h"

namespace clearance {
namespace {

// Floats relative to the index's origin, and the single precision of distances in L.
constexpr double kRounding = 2e-6;
constexpr double kFloatSlack_m = 5e-5;

double SlackOf(const ObjectIndex& index, const Eigen::Vector3d& p_W, double horizon_s) {
  return kFloatSlack_m + index.slack_m +
         kRounding * ((p_W - index.origin_W).lpNorm<1>() + 300 * horizon_s);
}

struct Posed {
  Eigen::Matrix3d R_L_W;
  Eigen::Vector3d t_W_L;
  Eigen::Vector3d ToL(const Eigen::Vector3d& p_W) const { return R_L_W * (p_W - t_W_L); }
};

Posed PoseAt(const ObjectIndex::Entry& entry, double horizon_s) {
  if (horizon_s == 0) return {entry.R_L_W, entry.t_W_L};
  const Pose H_W = ExpScrew(entry.screw_W * horizon_s);
  return {entry.R_L_W * H_W.linear().transpose(), H_W * entry.t_W_L};
}

}  // namespace

double LeastBetween(double d0_m, double d1_m, double length_m) {
  if (d0_m <= 0 || d1_m <= 0) return 0;
  if (length_m <= std::abs(d0_m - d1_m)) return std::min(d0_m, d1_m);
  if (length_m >= d0_m + d1_m) return 0;
  // Where the two spheres meet, along the segment.
  const double along = (length_m * length_m + d0_m * d0_m - d1_m * d1_m) / (2 * length_m);
  if (along <= 0 || along >= length_m) return std::min(d0_m, d1_m);
  return std::sqrt(std::max(0.0, d0_m * d0_m - along * along));
}

void CollectNearObjects(const ObjectIndex& index, const std::vector<uint8_t>& enabled,
                        const Eigen::AlignedBox3d& box_W, double horizon0_s, double horizon1_s,
                        double sigma_margin, double limit_m, std::vector<NearObject>* near) {
  near->clear();
  if (index.nodes.empty()) return;
  const Eigen::Array3f low = (box_W.min() - index.origin_W).cast<float>();
  const Eigen::Array3f high = (box_W.max() - index.origin_W).cast<float>();
  const float s0 = static_cast<float>(horizon0_s), s1 = static_cast<float>(horizon1_s);
  const double slack_m =
      std::max(SlackOf(index, box_W.min(), horizon1_s), SlackOf(index, box_W.max(), horizon1_s));
  std::vector<uint32_t> open = {0};
  while (!open.empty()) {
    const ObjectIndex::Node& node = index.nodes[open.back()];
    open.pop_back();
    Floats squared = AllOf(0);
    const Floats half = 0.5f * LoadFloats(node.acceleration_mps2);
    for (int axis = 0; axis < 3; ++axis) {
      // A lower bound is concave in time and an upper one convex: both are extreme at the ends.
      const Floats l = LoadFloats(node.lower[axis]), vl = LoadFloats(node.v_lower[axis]);
      const Floats u = LoadFloats(node.upper[axis]), vu = LoadFloats(node.v_upper[axis]);
      const Floats lower = LaneMin(l + s0 * vl - s0 * s0 * half, l + s1 * vl - s1 * s1 * half);
      const Floats upper = LaneMax(u + s0 * vu + s0 * s0 * half, u + s1 * vu + s1 * s1 * half);
      const Floats outside = LaneMax(LaneMax(lower - high[axis], low[axis] - upper), AllOf(0));
      squared += outside * outside;
    }
    for (int lane = 0; lane < kWays; ++lane) {
      if (node.lower[0][lane] == kFarAway) continue;
      const double reach_m =
          limit_m + sigma_margin * (node.sigma_m[lane] + s1 * node.sigma_growth_mps[lane]) +
          slack_m;
      if (squared[lane] > reach_m * reach_m) continue;
      const uint32_t child = node.child[lane];
      if (!(child & ObjectIndex::kEntry)) {
        open.push_back(child);
        continue;
      }
      NearObject object;
      object.entry = child & ~ObjectIndex::kEntry;
      if (!enabled.empty() && !enabled[object.entry]) continue;
      for (int axis = 0; axis < 3; ++axis) {
        object.lower[axis] = node.lower[axis][lane];
        object.upper[axis] = node.upper[axis][lane];
        object.v_lower[axis] = node.v_lower[axis][lane];
        object.v_upper[axis] = node.v_upper[axis][lane];
      }
      object.acceleration_mps2 = node.acceleration_mps2[lane];
      object.sigma_m = node.sigma_m[lane];
      object.sigma_growth_mps = node.sigma_growth_mps[lane];
      near->push_back(object);
    }
  }
}

double BoxBound(const ObjectIndex& index, const NearObject& object, const Sweep& sweep,
                double sigma_margin) {
  const Eigen::Array3f p0 = (sweep.p0_W - index.origin_W).cast<float>();
  const Eigen::Array3f p1 = (sweep.p1_W - index.origin_W).cast<float>();
  const float s0 = static_cast<float>(sweep.horizon0_s), s1 = static_cast<float>(sweep.horizon1_s);
  const float half = 0.5f * object.acceleration_mps2;
  const Eigen::Array3f lower = (object.lower + s0 * object.v_lower - s0 * s0 * half)
                                   .min(object.lower + s1 * object.v_lower - s1 * s1 * half);
  const Eigen::Array3f upper = (object.upper + s0 * object.v_upper + s0 * s0 * half)
                                   .max(object.upper + s1 * object.v_upper + s1 * s1 * half);
  const Eigen::Array3f outside = (lower - p0.max(p1)).max(p0.min(p1) - upper).max(0.f);
  return outside.matrix().norm() - sweep.deviation_m -
         sigma_margin * (object.sigma_m + s1 * object.sigma_growth_mps) -
         SlackOf(index, sweep.p0_W, sweep.horizon1_s);
}

double SurfaceBound(const ObjectIndex& index, const NearObject& object, const Sweep& sweep,
                    double least0_m, double least1_m, double sigma_margin) {
  const ObjectIndex::Entry& entry = index.entries[object.entry];
  const Eigen::Vector3d q0 = PoseAt(entry, sweep.horizon0_s).ToL(sweep.p0_W);
  const Eigen::Vector3d q1 = PoseAt(entry, sweep.horizon1_s).ToL(sweep.p1_W);
  // The way in L is q(t) with q' = R_L_W w, w = p' - v(p) relative to the body's velocity field
  // v(p) = v0 + omega x p, and q'' = R_L_W (p'' - omega x p' - omega x w).
  const double duration_s = sweep.horizon1_s - sweep.horizon0_s;
  const Eigen::Vector3d omega = entry.screw_W.tail<3>();
  const double turn = omega.norm() * duration_s;
  double deviation_m = sweep.deviation_m;
  if (turn > 0) {
    const double carried_m =
        duration_s * (entry.screw_W.head<3>() + omega.cross(sweep.p0_W)).norm();
    const double relative_m = sweep.travel_m * (1 + turn) + carried_m;
    deviation_m += turn * (sweep.travel_m + relative_m) / 8;
  }
  Eigen::AlignedBox3d way(q0.cwiseMin(q1), q0.cwiseMax(q1));
  way.min().array() -= deviation_m + kFloatSlack_m;
  way.max().array() += deviation_m + kFloatSlack_m;
  if (way.intersects(entry.bounds_L.cast<double>())) {
    return -std::numeric_limits<double>::infinity();
  }
  // No distance at an end is below the least one, which has lost at least the pose's sigma.
  double end0_m = least0_m, end1_m = least1_m, lost_m = 0;
  if (sigma_margin > 0) {
    const double pose0 = entry.position_sigma_m + entry.velocity_sigma_mps * sweep.horizon0_s;
    const double pose1 = entry.position_sigma_m + entry.velocity_sigma_mps * sweep.horizon1_s;
    end0_m += sigma_margin * pose0;
    end1_m += sigma_margin * pose1;
    lost_m = sigma_margin * std::hypot(entry.max_site_sigma_m, pose1);
  }
  return LeastBetween(end0_m, end1_m, (q1 - q0).norm()) - deviation_m - lost_m -
         SlackOf(index, sweep.p0_W, sweep.horizon1_s);
}

}  // namespace clearance
