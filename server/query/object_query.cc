#include "server/query/object_query.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "server/core/pose.h"
#include "server/query/lanes.h"
#include "server/query/object_tree.h"

namespace clearance {
namespace {

// Bounds are floats relative to the index's origin: a subtree is left out only beyond what their
// rounding can hide.
constexpr float kRounding = 1e-6f;
constexpr float kTopSpeedMps = 300;
// The score of what may hold the point: an object can answer anything down to minus its depth.
constexpr float kUnbounded = -1e30f;

// Lower bounds of distance - sigma_margin * sigma of all children.
[[gnu::always_inline]] inline Floats ScoreBounds(const ObjectIndex::Node& node,
                                                 const Eigen::Vector3f& p, float s, float slack_m,
                                                 float sigma_margin) {
  Floats squared = AllOf(0);
  const Floats deviation = 0.5f * s * s * LoadFloats(node.acceleration_mps2);
  for (int axis = 0; axis < 3; ++axis) {
    Floats below = LoadFloats(node.lower[axis]) - p[axis];
    Floats above = p[axis] - LoadFloats(node.upper[axis]);
    if (s != 0) {
      below += s * LoadFloats(node.v_lower[axis]) - deviation;
      above -= s * LoadFloats(node.v_upper[axis]) + deviation;
    }
    const Floats outside = LaneMax(LaneMax(below, above), AllOf(0));
    squared += outside * outside;
  }
  const Floats sigma = LoadFloats(node.sigma_m) + s * LoadFloats(node.sigma_growth_mps);
  const Floats score = LaneSqrt(squared) - (sigma_margin * sigma + slack_m);
  return squared == 0 ? AllOf(kUnbounded) : score;
}

}  // namespace

std::vector<uint8_t> EnabledEntries(const ObjectIndex& index, const LayerSelection& layers) {
  if (layers.only_objects.empty() && layers.without_objects.empty()) return {};
  const auto contains = [](const std::vector<ObjectId>& ids, ObjectId id) {
    return std::find(ids.begin(), ids.end(), id) != ids.end();
  };
  std::vector<uint8_t> enabled;
  enabled.reserve(index.entries.size());
  for (const ObjectIndex::Entry& entry : index.entries) {
    const bool wanted = layers.only_objects.empty() || contains(layers.only_objects, entry.id);
    enabled.push_back(wanted && !contains(layers.without_objects, entry.id));
  }
  return enabled;
}

float ObjectSigma(const ObjectIndex::Entry& entry, float site_sigma_m, double horizon_s) {
  const float pose =
      entry.position_sigma_m + entry.velocity_sigma_mps * static_cast<float>(horizon_s);
  return std::sqrt(site_sigma_m * site_sigma_m + pose * pose);
}

bool AskObject(const ObjectIndex::Entry& entry, const Eigen::Matrix3d& R_L_W,
               const Eigen::Vector3d& t_W_L, const Eigen::Vector3d& p_W, double horizon_s,
               float limit_m, ObjectAnswer* answer, int* nearest_site) {
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
  const NearestSurfel nearest =
      FindNearestSurfel(shape, p_L, limit_m, nearest_site != nullptr ? *nearest_site : -1);
  if (nearest.site < 0) return false;
  if (nearest_site != nullptr) *nearest_site = nearest.site;
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
    : index_(index),
      enabled_(enabled),
      sigma_margin_(sigma_margin),
      nearest_sites_(index.entries.size(), -1) {}

bool ObjectQuery::Ask(uint32_t i, const Eigen::Vector3d& p_W, double horizon_s, float limit_m,
                      ObjectAnswer* answer) {
  const ObjectIndex::Entry& entry = index_.entries[i];
  answer->entry = i;
  if (horizon_s == 0) {
    return AskObject(entry, entry.R_L_W, entry.t_W_L, p_W, 0, limit_m, answer, &nearest_sites_[i]);
  }
  if (posed_.empty()) posed_.resize(index_.entries.size());
  Posed& posed = posed_[i];
  if (posed.horizon_s != horizon_s) {
    const Pose H_W = ExpScrew(entry.screw_W * horizon_s);
    posed.horizon_s = horizon_s;
    posed.R_L_W = entry.R_L_W * H_W.linear().transpose();
    posed.t_W_L = H_W * entry.t_W_L;
  }
  return AskObject(entry, posed.R_L_W, posed.t_W_L, p_W, horizon_s, limit_m, answer,
                   &nearest_sites_[i]);
}

// Calls visit(entry, reach) for every enabled entry whose bounds allow a score of at most
// `limit()`: its surface must then lie within `reach` metres. Near subtrees first.
template <typename Limit, typename Visit>
void ObjectQuery::Traverse(const Eigen::Vector3d& p_W, double horizon_s, Limit limit, Visit visit) {
  if (index_.nodes.empty()) return;
  const Eigen::Vector3f p = (p_W - index_.origin_W).cast<float>();
  const float s = static_cast<float>(horizon_s);
  // The boxes' own coordinates, the point's, and how far the boxes may have come since.
  const float slack_m = index_.slack_m + kRounding * p.lpNorm<1>() + kRounding * s * kTopSpeedMps;
  VisitStack stack;
  const ObjectIndex::Node* node = &index_.nodes[0];
  while (true) {
    stack.Push(ScoreBounds(*node, p, s, slack_m, sigma_margin_), node->child, limit());
    node = nullptr;
    while (node == nullptr) {
      if (stack.empty()) return;
      const VisitStack::Visit next = stack.Pop();
      if (next.bound > limit()) continue;
      if (!(next.child & ObjectIndex::kEntry)) {
        node = &index_.nodes[next.child];
        continue;
      }
      const uint32_t i = next.child & ~ObjectIndex::kEntry;
      if (!enabled_.empty() && !enabled_[i]) continue;
      const ObjectIndex::Entry& entry = index_.entries[i];
      const float sigma_m =
          entry.max_site_sigma_m + entry.position_sigma_m + s * entry.velocity_sigma_mps;
      visit(i, limit() + sigma_margin_ * sigma_m + slack_m);
    }
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
