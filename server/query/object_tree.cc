#include "server/query/object_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace clearance {
namespace {

constexpr uint32_t kLeafSites = 8;
constexpr int kStackDepth = 64;  // median splits halve: more than any 32-bit count needs

// Half extents of the disc's box: a disc reaches r sqrt(1 - n_a^2) along axis a.
Eigen::Vector3f DiscExtent(const SurfaceSite& site, float radius_m) {
  return radius_m * (1.f - site.normal_L.array().square()).max(0.f).sqrt();
}

Eigen::AlignedBox3f DiscBox(const SurfaceSite& site, float radius_m) {
  const Eigen::Vector3f extent = DiscExtent(site, radius_m);
  return {site.p_L - extent, site.p_L + extent};
}

// Splits at the median of the widest axis; children are neighbours, so that one index names both.
class TreeBuilder {
 public:
  TreeBuilder(std::vector<SurfaceSite>& sites, float radius_m,
              std::vector<ObjectShape::Node>& nodes)
      : sites_(sites), radius_m_(radius_m), nodes_(nodes) {}

  void Build() {
    nodes_.resize(1);
    Split(0, 0, static_cast<uint32_t>(sites_.size()));
  }

 private:
  void Split(uint32_t node, uint32_t first, uint32_t count) {
    Eigen::AlignedBox3f box, centres;
    for (uint32_t i = first; i < first + count; ++i) {
      box.extend(DiscBox(sites_[i], radius_m_));
      centres.extend(sites_[i].p_L);
    }
    for (int axis = 0; axis < 3; ++axis) {
      nodes_[node].lower[axis] = box.min()[axis];
      nodes_[node].upper[axis] = box.max()[axis];
    }
    if (count <= kLeafSites) {
      nodes_[node].first = first;
      nodes_[node].count = count;
      return;
    }
    int axis;
    centres.sizes().maxCoeff(&axis);
    const auto begin = sites_.begin() + first;
    const uint32_t half = count / 2;
    std::nth_element(
        begin, begin + half, begin + count,
        [axis](const SurfaceSite& a, const SurfaceSite& b) { return a.p_L[axis] < b.p_L[axis]; });
    const auto left = static_cast<uint32_t>(nodes_.size());
    nodes_[node].first = left;
    nodes_.resize(left + 2);
    Split(left, first, half);
    Split(left + 1, first + half, count - half);
  }

  std::vector<SurfaceSite>& sites_;
  float radius_m_;
  std::vector<ObjectShape::Node>& nodes_;
};

float SquaredDistance(const ObjectShape::Node& node, const Eigen::Vector3f& p) {
  float sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const float outside =
        std::max(std::max(node.lower[axis] - p[axis], p[axis] - node.upper[axis]), 0.f);
    sum += outside * outside;
  }
  return sum;
}

// Rounding of a box distance against a surfel's: a box is left out only when it is farther than the
// best by more than float can err, so that culling never changes the answer.
constexpr float kRounding = 1e-5f;

// Calls visit(site index) for every leaf site whose box may be within `limit()` metres; near boxes
// first.
template <typename Limit, typename Visit>
void Traverse(const ObjectShape& shape, const Eigen::Vector3f& p, Limit limit, Visit visit) {
  if (shape.nodes.empty()) return;
  std::array<std::pair<float, uint32_t>, kStackDepth> stack;
  int depth = 0;
  stack[depth++] = {SquaredDistance(shape.nodes[0], p), 0};
  while (depth > 0) {
    const auto [squared, index] = stack[--depth];
    const float reach = limit() * (1 + kRounding) + kRounding * shape.voxel_size_m;
    if (squared > reach * reach) continue;
    const ObjectShape::Node& node = shape.nodes[index];
    if (node.count > 0) {
      for (uint32_t i = node.first; i < node.first + node.count; ++i) visit(i);
      continue;
    }
    std::pair<float, uint32_t> near{SquaredDistance(shape.nodes[node.first], p), node.first};
    std::pair<float, uint32_t> far{SquaredDistance(shape.nodes[node.first + 1], p), node.first + 1};
    if (far.first < near.first) std::swap(near, far);
    stack[depth++] = far;
    stack[depth++] = near;
  }
}

float RadiusOf(const ObjectShape& shape) {
  return kSurfelRadiusVoxels * static_cast<float>(shape.voxel_size_m);
}

}  // namespace

std::shared_ptr<const ObjectShape> BuildObjectShape(std::vector<SurfaceSite> sites,
                                                    double voxel_size_m) {
  auto shape = std::make_shared<ObjectShape>();
  shape->voxel_size_m = voxel_size_m;
  shape->sites = std::move(sites);
  std::erase_if(shape->sites, [](const SurfaceSite& site) {
    return !site.p_L.allFinite() || !site.normal_L.allFinite() || !std::isfinite(site.sigma_m);
  });
  if (shape->sites.empty()) return shape;
  const float radius_m = RadiusOf(*shape);
  for (const SurfaceSite& site : shape->sites) shape->bounds_L.extend(DiscBox(site, radius_m));
  TreeBuilder(shape->sites, radius_m, shape->nodes).Build();
  return shape;
}

SurfelDistance DistanceToSurfel(const SurfaceSite& site, float radius_m,
                                const Eigen::Vector3f& p_L) {
  const Eigen::Vector3f v = p_L - site.p_L;
  const float height = site.normal_L.dot(v);
  const float lateral = (v - height * site.normal_L).norm();
  const float beyond = std::max(0.f, lateral - radius_m);
  return {std::sqrt(height * height + beyond * beyond), height};
}

Eigen::Vector3f DirectionFromSurfel(const SurfaceSite& site, float radius_m,
                                    const Eigen::Vector3f& p_L) {
  const Eigen::Vector3f v = p_L - site.p_L;
  const float height = site.normal_L.dot(v);
  const Eigen::Vector3f tangent = v - height * site.normal_L;
  const float lateral = tangent.norm();
  Eigen::Vector3f direction = height * site.normal_L;
  if (lateral > radius_m) direction += tangent * ((lateral - radius_m) / lateral);
  const float norm = direction.norm();
  return norm > 1e-6f ? Eigen::Vector3f(direction / norm) : site.normal_L;
}

NearestSurfel FindNearestSurfel(const ObjectShape& shape, const Eigen::Vector3f& p_L,
                                float limit_m) {
  const float radius_m = RadiusOf(shape);
  NearestSurfel best{-1, limit_m};
  Traverse(
      shape, p_L, [&] { return best.distance_m; },
      [&](uint32_t i) {
        const float d = DistanceToSurfel(shape.sites[i], radius_m, p_L).distance_m;
        const int site = static_cast<int>(i);
        if (d < best.distance_m || (d == best.distance_m && (best.site < 0 || site < best.site))) {
          best = {site, d};
        }
      });
  return best;
}

bool IsInside(const ObjectShape& shape, const Eigen::Vector3f& p_L, float nearest_m) {
  if (!shape.bounds_L.contains(p_L)) return false;
  const float voxel_m = static_cast<float>(shape.voxel_size_m);
  const float radius_m = RadiusOf(shape);
  const float limit_m = nearest_m + voxel_m;
  // Visiting order may differ between builds of a tree, not within one: the sum is deterministic.
  double votes = 0;
  Traverse(
      shape, p_L, [&] { return limit_m; },
      [&](uint32_t i) {
        const SurfelDistance surfel = DistanceToSurfel(shape.sites[i], radius_m, p_L);
        if (surfel.distance_m > limit_m) return;
        const float weight = (limit_m - surfel.distance_m) / voxel_m;
        const float range = (p_L - shape.sites[i].p_L).norm();
        votes += weight * surfel.height_m / std::max(range, 1e-6f);
      });
  return votes < 0;
}

}  // namespace clearance
