#include "planner_demo/sim/ray_caster.h"

#include <algorithm>
#include <array>

namespace clearance::sim {
namespace {

constexpr int kLeafSize = 2;

// Where the ray enters the box, or infinity where it misses it or enters beyond max_t.
double EntersBox(const Eigen::AlignedBox3d& box, const Eigen::Vector3d& origin,
                 const Eigen::Vector3d& inverse, double max_t) {
  double enter = 0.0;
  double exit = max_t;
  for (int axis = 0; axis < 3; ++axis) {
    const double a = (box.min()[axis] - origin[axis]) * inverse[axis];
    const double b = (box.max()[axis] - origin[axis]) * inverse[axis];
    // NaN (0 * infinity) needs a ray within a face of the box, which lies outside of the solid, as
    // Add leaves room: either answer is right.
    enter = std::max(enter, std::min(a, b));
    exit = std::min(exit, std::max(a, b));
  }
  return enter <= exit ? enter : std::numeric_limits<double>::infinity();
}

}  // namespace

void RayCaster::Add(const std::vector<Solid>& solids, const Eigen::Isometry3d& T_W_B,
                    uint16_t owner) {
  for (const Solid& solid : solids) {
    const Solid in_W{solid.shape, T_W_B * solid.T_B_S};
    Eigen::AlignedBox3d bounds_W = Bounds(in_W);
    // Room for rounding, so that a ray along a face still reaches the exact test.
    bounds_W.min().array() -= 1e-9 + 1e-12 * bounds_W.min().array().abs();
    bounds_W.max().array() += 1e-9 + 1e-12 * bounds_W.max().array().abs();
    solids_.push_back({solid.shape, in_W.T_B_S.inverse(), bounds_W, owner});
  }
}

void RayCaster::Build() {
  order_.resize(solids_.size());
  for (size_t i = 0; i < order_.size(); ++i) order_[i] = static_cast<int>(i);
  nodes_.clear();
  if (!solids_.empty()) BuildNode(0, static_cast<int>(solids_.size()));
}

int RayCaster::BuildNode(int begin, int end) {
  const int index = static_cast<int>(nodes_.size());
  nodes_.emplace_back();
  Eigen::AlignedBox3d bounds;
  Eigen::AlignedBox3d centres;
  for (int i = begin; i < end; ++i) {
    bounds.extend(solids_[order_[i]].bounds_W);
    centres.extend(solids_[order_[i]].bounds_W.center());
  }
  int axis = 0;
  centres.sizes().maxCoeff(&axis);
  if (end - begin <= kLeafSize) {
    nodes_[index] = {bounds, begin, end - begin, axis};
    return index;
  }
  const int middle = (begin + end) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](int a, int b) {
                     const double ca = solids_[a].bounds_W.center()[axis];
                     const double cb = solids_[b].bounds_W.center()[axis];
                     return ca != cb ? ca < cb : a < b;
                   });
  BuildNode(begin, middle);
  const int right = BuildNode(middle, end);
  nodes_[index] = {bounds, right, 0, axis};
  return index;
}

void RayCaster::Test(int solid, const Eigen::Vector3d& origin_W, const Eigen::Vector3d& direction_W,
                     Hit& best) const {
  const Placed& placed = solids_[solid];
  const Interval inside =
      Intersect(placed.shape, placed.T_S_W * origin_W, placed.T_S_W.linear() * direction_W);
  if (inside.enter > inside.exit) return;
  const double t = inside.enter > 0.0 ? inside.enter : inside.exit;
  if (t <= 0.0) return;
  // Coinciding faces go to the solid added first, whatever the order of the tests.
  if (t < best.t || (t == best.t && solid < best.solid)) best = {t, placed.owner, solid};
}

RayCaster::Hit RayCaster::Cast(const Eigen::Vector3d& origin_W, const Eigen::Vector3d& direction_W,
                               double max_t, int hint) const {
  Hit best;
  if (nodes_.empty()) return best;
  if (hint >= 0) Test(hint, origin_W, direction_W, best);
  const Eigen::Vector3d inverse = direction_W.cwiseInverse();
  std::array<int, 64> stack;
  int depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const int index = stack[--depth];
    const Node& node = nodes_[index];
    const double reach = std::min(best.t, max_t);
    if (EntersBox(node.bounds_W, origin_W, inverse, reach) > reach) continue;
    if (node.count > 0) {
      for (int i = node.first; i < node.first + node.count; ++i) {
        Test(order_[i], origin_W, direction_W, best);
      }
      continue;
    }
    const bool forward = direction_W[node.axis] >= 0.0;
    stack[depth++] = forward ? node.first : index + 1;
    stack[depth++] = forward ? index + 1 : node.first;
  }
  return best.t <= max_t ? best : Hit{};
}

}  // namespace clearance::sim
