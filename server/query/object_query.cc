#include "server/query/object_query.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "server/core/pose.h"
#include "server/query/object_tree.h"

namespace clearance {
namespace {

constexpr int kStackDepth = 64;
// Bounds are floats relative to the index's origin: a subtree is left out only beyond what their
// rounding can hide.
constexpr float kRounding = 1e-6f;

// A lower bound of the distance to everything below the node.
float DistanceBound(const ObjectIndex::Node& node, const Eigen::Array4f& p, float s) {
  Eigen::Array4f below = node.lower - p, above = p - node.upper;
  if (s != 0) {
    const float deviation = 0.5f * s * s * node.acceleration_mps2;
    below += s * node.v_lower - deviation;
    above -= s * node.v_upper + deviation;
    below[3] = above[3] = 0;
  }
  return std::sqrt(below.max(above).max(0.f).square().sum());
}

}  // namespace

float ObjectSigma(const ObjectIndex::Entry& entry, float site_sigma_m, double horizon_s) {
  const float pose =
      entry.position_sigma_m + entry.velocity_sigma_mps * static_cast<float>(horizon_s);
  return std::sqrt(site_sigma_m * site_sigma_m + pose * pose);
}

bool AskObject(const ObjectIndex::Entry& entry, const Eigen::Matrix3d& R_L_W,
               const Eigen::Vector3d& t_W_L, const Eigen::Vector3d& p_W, double horizon_s,
               float limit_m, ObjectAnswer* answer) {
  const ObjectShape& shape = *entry.shape;
  const Eigen::Vector3f p_L = (R_L_W * (p_W - t_W_L)).cast<float>();
  const bool in_bounds = entry.bounds_L.contains(p_L);
  // Deep inside, a surface far away still decides: the search is unbounded there.
  if (in_bounds) {
    limit_m = std::numeric_limits<float>::max();
  } else if (limit_m < 0 || entry.bounds_L.squaredExteriorDistance(p_L) >
                                limit_m * limit_m * (1 + 1e-5f) + 1e-10f) {
    return false;
  }
  const NearestSurfel nearest = FindNearestSurfel(shape, p_L, limit_m);
  if (nearest.site < 0) return false;
  const SurfaceSite& site = shape.sites[nearest.site];
  const bool inside = in_bounds && IsInside(shape, p_L, nearest.distance_m);
  answer->distance_m = inside ? -nearest.distance_m : nearest.distance_m;
  answer->sigma_m = ObjectSigma(entry, site.sigma_m, horizon_s);
  Eigen::Vector3f gradient_L =
      DirectionFromSurfel(site, kSurfelRadiusVoxels * static_cast<float>(shape.voxel_size_m), p_L);
  // On the disc itself the direction is the normal, on either side of it.
  if (inside && nearest.distance_m > 1e-6f) gradient_L = -gradient_L;
  answer->gradient_W = R_L_W.transpose().cast<float>() * gradient_L;
  return true;
}

ObjectQuery::ObjectQuery(const ObjectIndex& index, const std::vector<uint8_t>& enabled,
                         float sigma_margin)
    : index_(index), enabled_(enabled), sigma_margin_(sigma_margin) {}

bool ObjectQuery::Ask(uint32_t i, const Eigen::Vector3d& p_W, double horizon_s, float limit_m,
                      ObjectAnswer* answer) {
  const ObjectIndex::Entry& entry = index_.entries[i];
  answer->entry = i;
  if (horizon_s == 0) {
    return AskObject(entry, entry.R_L_W, entry.t_W_L, p_W, 0, limit_m, answer);
  }
  if (posed_.empty()) posed_.resize(index_.entries.size());
  Posed& posed = posed_[i];
  if (posed.horizon_s != horizon_s) {
    const Pose H_W = ExpScrew(entry.screw_W * horizon_s);
    posed.horizon_s = horizon_s;
    posed.R_L_W = entry.R_L_W * H_W.linear().transpose();
    posed.t_W_L = H_W * entry.t_W_L;
  }
  return AskObject(entry, posed.R_L_W, posed.t_W_L, p_W, horizon_s, limit_m, answer);
}

// Calls visit(entry, reach) for every enabled entry whose bounds allow a score of at most
// `limit()`: its surface must then lie within `reach` metres. Near subtrees first.
template <typename Limit, typename Visit>
void ObjectQuery::Traverse(const Eigen::Vector3d& p_W, double horizon_s, Limit limit, Visit visit) {
  if (index_.nodes.empty()) return;
  const Eigen::Vector3f local = (p_W - index_.origin_W).cast<float>();
  const Eigen::Array4f p(local.x(), local.y(), local.z(), 0.f);
  const float s = static_cast<float>(horizon_s);
  const ObjectIndex::Node& root = index_.nodes[0];
  const float slack = kRounding * (local.lpNorm<1>() + (root.upper.abs() + root.lower.abs()).sum() +
                                   s * (root.v_upper.abs() + root.v_lower.abs()).sum() +
                                   s * s * root.acceleration_mps2);
  const auto margin = [&](const ObjectIndex::Node& node) {
    return sigma_margin_ * (node.sigma_m + s * node.sigma_growth_mps) + slack;
  };
  std::array<std::pair<float, uint32_t>, kStackDepth> stack;
  int depth = 0;
  stack[depth++] = {DistanceBound(root, p, s), 0};
  while (depth > 0) {
    const auto [bound, n] = stack[--depth];
    const ObjectIndex::Node& node = index_.nodes[n];
    // Inside its box an object may answer anything down to minus its depth.
    if (bound > 0 && bound > limit() + margin(node)) continue;
    if (node.count > 0) {
      for (uint32_t i = node.first; i < node.first + node.count; ++i) {
        if (enabled_.empty() || enabled_[i]) visit(i, limit() + margin(node));
      }
      continue;
    }
    std::pair<float, uint32_t> near{DistanceBound(index_.nodes[node.first], p, s), node.first};
    std::pair<float, uint32_t> far{DistanceBound(index_.nodes[node.first + 1], p, s),
                                   node.first + 1};
    if (far.first < near.first) std::swap(near, far);
    stack[depth++] = far;
    stack[depth++] = near;
  }
}

bool ObjectQuery::Nearest(const Eigen::Vector3d& p_W, double horizon_s, float limit_m,
                          ObjectAnswer* answer) {
  float best = limit_m;
  bool found = false;
  ObjectAnswer candidate;
  Traverse(
      p_W, horizon_s, [&] { return best; },
      [&](uint32_t i, float reach_m) {
        if (!Ask(i, p_W, horizon_s, reach_m, &candidate)) return;
        const float score = candidate.distance_m - sigma_margin_ * candidate.sigma_m;
        const bool ties =
            found && score == best && index_.entries[i].id < index_.entries[answer->entry].id;
        if (score < best || ties) {
          best = score;
          *answer = candidate;
          found = true;
        }
      });
  return found;
}

void ObjectQuery::Within(const Eigen::Vector3d& p_W, double horizon_s, float limit_m,
                         std::vector<ObjectAnswer>* answers) {
  answers->clear();
  ObjectAnswer candidate;
  Traverse(
      p_W, horizon_s, [&] { return limit_m; },
      [&](uint32_t i, float reach_m) {
        if (Ask(i, p_W, horizon_s, reach_m, &candidate) && candidate.distance_m < limit_m) {
          answers->push_back(candidate);
        }
      });
}

}  // namespace clearance
