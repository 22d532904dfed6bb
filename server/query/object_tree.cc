#include "server/query/object_tree.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "server/query/lanes.h"
#include "server/query/shape_codec.h"
#include "server/query/surfel_tree.h"

namespace clearance {
namespace {

// The half extents of the disc's box: a disc reaches r sqrt(1 - n_a^2) along axis a.
Eigen::AlignedBox3f DiscBox(const SurfaceSite& site, float radius_m) {
  const Eigen::Vector3f extent = radius_m * (1.f - site.normal_L.array().square()).max(0.f).sqrt();
  return {site.p_L - extent, site.p_L + extent};
}

class TreeBuilder {
 public:
  TreeBuilder(std::vector<SurfaceSite>& sites, float radius_m, SurfelTree& tree)
      : sites_(sites), radius_m_(radius_m), tree_(tree) {}

  // The node over sites [first, first + count); returns its index.
  uint32_t Split(uint32_t first, uint32_t count) {
    std::array<uint32_t, kWays + 1> bounds;
    const int runs = CutInEight(
        std::span(sites_).subspan(first, count),
        [](const SurfaceSite& site) {
          return std::array<float, 3>{site.p_L.x(), site.p_L.y(), site.p_L.z()};
        },
        // Sites at one place are alike for all that a tree does.
        [](const SurfaceSite& site) { return site.sigma_m; }, &bounds);
    const auto index = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes.emplace_back();
    for (int lane = 0; lane < kWays; ++lane) {
      const bool used = lane < runs && bounds[lane] < bounds[lane + 1];
      const uint32_t begin = used ? first + bounds[lane] : 0;
      const uint32_t size = used ? bounds[lane + 1] - bounds[lane] : 0;
      SetBox(index, lane, begin, size);
      const uint32_t child = !used ? 0 : size <= kWays ? MakeLeaf(begin, size) : Split(begin, size);
      tree_.nodes[index].child[lane] = child;
    }
    return index;
  }

 private:
  void SetBox(uint32_t node, int lane, uint32_t begin, uint32_t size) {
    Eigen::AlignedBox3f box;
    for (uint32_t i = begin; i < begin + size; ++i) box.extend(DiscBox(sites_[i], radius_m_));
    for (int axis = 0; axis < 3; ++axis) {
      tree_.nodes[node].lower[axis][lane] = size > 0 ? box.min()[axis] : kFarAway;
      tree_.nodes[node].upper[axis][lane] = size > 0 ? box.max()[axis] : kFarAway;
    }
  }

  uint32_t MakeLeaf(uint32_t begin, uint32_t size) {
    SurfelTree::Leaf leaf;
    leaf.first = begin;
    leaf.count = size;
    for (uint32_t lane = 0; lane < kWays; ++lane) {
      for (int axis = 0; axis < 3; ++axis) {
        leaf.p[axis][lane] = lane < size ? sites_[begin + lane].p_L[axis] : kFarAway;
        leaf.normal[axis][lane] = lane < size ? sites_[begin + lane].normal_L[axis] : 0.f;
      }
    }
    tree_.leaves.push_back(leaf);
    return SurfelTree::kLeaf | static_cast<uint32_t>(tree_.leaves.size() - 1);
  }

  std::vector<SurfaceSite>& sites_;
  float radius_m_;
  SurfelTree& tree_;
};

// One surfel's distance. Lanes and single sites run the same operations, so that a tree and a loop
// over all sites agree bit for bit.
template <typename T>
struct Measure {
  T distance_m, height_m, squared_range;
};
template <typename T>
[[gnu::always_inline]] inline Measure<T> MeasureSurfel(T vx, T vy, T vz, T nx, T ny, T nz,
                                                       T radius_m) {
  const T height = nx * vx + ny * vy + nz * vz;
  const T tx = vx - height * nx, ty = vy - height * ny, tz = vz - height * nz;
  const T lateral = LaneSqrt(tx * tx + ty * ty + tz * tz);
  const T beyond = LaneMax(T{}, lateral - radius_m);
  return {LaneSqrt(height * height + beyond * beyond), height, vx * vx + vy * vy + vz * vz};
}

[[gnu::always_inline]] inline Measure<Floats> MeasureLeaf(const SurfelTree::Leaf& leaf,
                                                          const Eigen::Vector3f& p,
                                                          float radius_m) {
  return MeasureSurfel<Floats>(p.x() - LoadFloats(leaf.p[0]), p.y() - LoadFloats(leaf.p[1]),
                               p.z() - LoadFloats(leaf.p[2]), LoadFloats(leaf.normal[0]),
                               LoadFloats(leaf.normal[1]), LoadFloats(leaf.normal[2]),
                               AllOf(radius_m));
}

[[gnu::always_inline]] inline Floats MeasureBoxes(const SurfelTree::Node& node,
                                                  const Eigen::Vector3f& p) {
  Floats sum = AllOf(0);
  for (int axis = 0; axis < 3; ++axis) {
    const Floats outside = LaneMax(
        LaneMax(LoadFloats(node.lower[axis]) - p[axis], p[axis] - LoadFloats(node.upper[axis])),
        AllOf(0));
    sum += outside * outside;
  }
  return sum;
}

// Rounding of a box distance against a surfel's: a box is left out only when it is farther than the
// best by more than float can err, so that culling never changes the answer.
constexpr float kRounding = 1e-5f;

// Calls visit(leaf) for every leaf whose box may be within `limit()` metres; near ones first.
template <typename Limit, typename Visit>
void Traverse(const ObjectShape& shape, const Eigen::Vector3f& p, Limit limit, Visit visit) {
  if (shape.tree == nullptr) return;
  const SurfelTree& tree = *shape.tree;
  const float slack_m = kRounding * static_cast<float>(shape.voxel_size_m);
  const auto reach_squared = [&] {
    const float reach = limit() * (1 + kRounding) + slack_m;
    return reach * reach;
  };
  VisitStack stack;
  stack.Push(MeasureBoxes(tree.nodes[0], p), tree.nodes[0].child, reach_squared());
  while (!stack.empty()) {
    const VisitStack::Visit next = stack.Pop();
    const float reach = reach_squared();
    if (next.bound > reach) continue;
    if (next.child & SurfelTree::kLeaf) {
      visit(tree.leaves[next.child & ~SurfelTree::kLeaf]);
      continue;
    }
    const SurfelTree::Node& node = tree.nodes[next.child];
    stack.Push(MeasureBoxes(node, p), node.child, reach);
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
  // The tree follows from the set of sites, whatever their order: a mirror that builds it from the
  // sites in tree order gets the same one.
  std::sort(shape->sites.begin(), shape->sites.end(), ComesFirst);
  const float radius_m = RadiusOf(*shape);
  for (const SurfaceSite& site : shape->sites) {
    shape->bounds_L.extend(DiscBox(site, radius_m));
    shape->max_sigma_m = std::max(shape->max_sigma_m, site.sigma_m);
  }
  auto tree = std::make_shared<SurfelTree>();
  TreeBuilder(shape->sites, radius_m, *tree).Split(0, static_cast<uint32_t>(shape->sites.size()));
  shape->tree = std::move(tree);
  return shape;
}

SurfelDistance DistanceToSurfel(const SurfaceSite& site, float radius_m,
                                const Eigen::Vector3f& p_L) {
  const Measure<float> measure =
      MeasureSurfel<float>(p_L.x() - site.p_L.x(), p_L.y() - site.p_L.y(), p_L.z() - site.p_L.z(),
                           site.normal_L.x(), site.normal_L.y(), site.normal_L.z(), radius_m);
  return {measure.distance_m, measure.height_m};
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

NearestSurfel FindNearestSurfel(const ObjectShape& shape, const Eigen::Vector3f& p_L, float limit_m,
                                int seed) {
  const float radius_m = RadiusOf(shape);
  NearestSurfel best{-1, limit_m};
  if (seed >= 0) {
    const float d = DistanceToSurfel(shape.sites[seed], radius_m, p_L).distance_m;
    if (d <= limit_m) best = {seed, d};
  }
  Traverse(
      shape, p_L, [&] { return best.distance_m; },
      [&](const SurfelTree::Leaf& leaf) {
        const Floats distance = MeasureLeaf(leaf, p_L, radius_m).distance_m;
        for (unsigned near = AtMost(distance, best.distance_m); near != 0; near &= near - 1) {
          const int i = std::countr_zero(near);
          const int site = static_cast<int>(leaf.first) + i;
          if (distance[i] < best.distance_m ||
              (distance[i] == best.distance_m && (best.site < 0 || site < best.site))) {
            best = {site, distance[i]};
          }
        }
      });
  return best;
}

bool IsInside(const ObjectShape& shape, const Eigen::Vector3f& p_L, float nearest_m) {
  if (!shape.bounds_L.contains(p_L)) return false;
  const float voxel_m = static_cast<float>(shape.voxel_size_m);
  const float radius_m = RadiusOf(shape);
  const float limit_m = nearest_m + voxel_m;
  // The order of visits follows from the tree and the point alone: the sum is deterministic.
  float votes = 0;
  Traverse(
      shape, p_L, [&] { return limit_m; },
      [&](const SurfelTree::Leaf& leaf) {
        const Measure<Floats> measure = MeasureLeaf(leaf, p_L, radius_m);
        const Floats weight = LaneMax(AllOf(0), limit_m - measure.distance_m);
        const Floats range = LaneSqrt(LaneMax(measure.squared_range, AllOf(1e-12f)));
        votes += SumOfLanes(weight * measure.height_m / range);
      });
  return votes < 0;
}

}  // namespace clearance
