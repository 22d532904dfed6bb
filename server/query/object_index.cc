#include "server/query/object_index.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <span>
#include <utility>

namespace clearance {
namespace {

// Objects are grouped by where they are now and where they will be then: traffic that parts does
// not share a box.
constexpr float kGroupingHorizonS = 2;
constexpr float kRounding = 1e-6f;

ObjectIndex::Entry MakeEntry(const ObjectView& object, uint32_t index) {
  ObjectIndex::Entry entry;
  entry.R_L_W = object.T_W_L.linear().transpose();
  entry.t_W_L = object.T_W_L.translation();
  entry.screw_W = object.screw_W;
  entry.bounds_L = object.shape->bounds_L;
  entry.position_sigma_m = static_cast<float>(object.position_sigma_m);
  entry.velocity_sigma_mps = static_cast<float>(object.velocity_sigma_mps);
  entry.max_site_sigma_m = object.shape->max_sigma_m;
  entry.object = index;
  entry.id = object.id;
  entry.life_state = object.life_state;
  entry.shape = object.shape;
  return entry;
}

struct Bounds {
  Eigen::Array3f lower, upper, v_lower, v_upper;
  float acceleration_mps2, sigma_m, sigma_growth_mps;

  void Extend(const Bounds& other) {
    lower = lower.min(other.lower);
    upper = upper.max(other.upper);
    v_lower = v_lower.min(other.v_lower);
    v_upper = v_upper.max(other.v_upper);
    acceleration_mps2 = std::max(acceleration_mps2, other.acceleration_mps2);
    sigma_m = std::max(sigma_m, other.sigma_m);
    sigma_growth_mps = std::max(sigma_growth_mps, other.sigma_growth_mps);
  }
};

// Bounds of one box now, of its velocities and of its acceleration: all three are extreme at
// corners, since a body's velocity is linear in the point and its length convex.
Bounds BoundsOf(const ObjectIndex::Entry& entry, const Eigen::Vector3d& origin_W) {
  const Eigen::Vector3d linear = entry.screw_W.head<3>();
  const Eigen::Vector3d angular = entry.screw_W.tail<3>();
  Eigen::AlignedBox3d box, velocities;
  double acceleration = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d p_L =
        entry.bounds_L.corner(static_cast<Eigen::AlignedBox3f::CornerType>(corner)).cast<double>();
    const Eigen::Vector3d p_W = entry.R_L_W.transpose() * p_L + entry.t_W_L;
    const Eigen::Vector3d velocity = linear + angular.cross(p_W);
    box.extend(p_W - origin_W);
    velocities.extend(velocity);
    acceleration = std::max(acceleration, angular.cross(velocity).norm());
  }
  return {box.min().cast<float>(),          box.max().cast<float>(),
          velocities.min().cast<float>(),   velocities.max().cast<float>(),
          static_cast<float>(acceleration), entry.max_site_sigma_m + entry.position_sigma_m,
          entry.velocity_sigma_mps};
}

class IndexBuilder {
 public:
  explicit IndexBuilder(ObjectIndex& index) : index_(index), order_(index.entries.size()) {
    for (const ObjectIndex::Entry& entry : index.entries) {
      bounds_.push_back(BoundsOf(entry, index.origin_W));
      const Eigen::Array3f far = bounds_.back().lower.abs().max(bounds_.back().upper.abs());
      index.slack_m = std::max(index.slack_m, kRounding * far.sum());
    }
    std::iota(order_.begin(), order_.end(), 0u);
  }

  void Build() {
    Split(0, static_cast<uint32_t>(order_.size()));
    std::vector<ObjectIndex::Entry> sorted;
    sorted.reserve(order_.size());
    for (uint32_t i : order_) sorted.push_back(std::move(index_.entries[i]));
    index_.entries = std::move(sorted);
  }

 private:
  // The node over order_[first, first + count); returns its index.
  uint32_t Split(uint32_t first, uint32_t count) {
    std::array<uint32_t, kWays + 1> cuts;
    const int runs = CutInEight(
        std::span(order_).subspan(first, count), [this](uint32_t i) { return Key(i); },
        [](uint32_t i) { return i; }, &cuts);
    const auto index = static_cast<uint32_t>(index_.nodes.size());
    index_.nodes.emplace_back();
    for (int lane = 0; lane < kWays; ++lane) {
      const uint32_t size = lane < runs ? cuts[lane + 1] - cuts[lane] : 0;
      const uint32_t begin = size > 0 ? first + cuts[lane] : 0;
      SetLane(index_.nodes[index], lane, begin, size);
      const uint32_t child = size == 0   ? 0
                             : size == 1 ? ObjectIndex::kEntry | begin
                                         : Split(begin, size);
      index_.nodes[index].child[lane] = child;
    }
    return index;
  }

  void SetLane(ObjectIndex::Node& node, int lane, uint32_t begin, uint32_t size) {
    const Eigen::Array3f far = Eigen::Array3f::Constant(kFarAway), zero = Eigen::Array3f::Zero();
    Bounds bounds{far, far, zero, zero, 0, 0, 0};
    for (uint32_t i = begin; i < begin + size; ++i) {
      if (i == begin) bounds = bounds_[order_[i]];
      bounds.Extend(bounds_[order_[i]]);
    }
    for (int axis = 0; axis < 3; ++axis) {
      node.lower[axis][lane] = bounds.lower[axis];
      node.upper[axis][lane] = bounds.upper[axis];
      node.v_lower[axis][lane] = bounds.v_lower[axis];
      node.v_upper[axis][lane] = bounds.v_upper[axis];
    }
    node.acceleration_mps2[lane] = bounds.acceleration_mps2;
    node.sigma_m[lane] = bounds.sigma_m;
    node.sigma_growth_mps[lane] = bounds.sigma_growth_mps;
  }

  std::array<float, 6> Key(uint32_t i) const {
    const Bounds& b = bounds_[i];
    const Eigen::Array3f now = b.lower + b.upper;
    const Eigen::Array3f then = now + kGroupingHorizonS * (b.v_lower + b.v_upper);
    return {now.x(), now.y(), now.z(), then.x(), then.y(), then.z()};
  }

  ObjectIndex& index_;
  std::vector<uint32_t> order_;
  std::vector<Bounds> bounds_;
};

}  // namespace

std::shared_ptr<const ObjectIndex> BuildObjectIndex(const std::vector<ObjectView>& objects) {
  auto index = std::make_shared<ObjectIndex>();
  for (size_t i = 0; i < objects.size(); ++i) {
    const ObjectView& object = objects[i];
    if (object.life_state == LifeState::kRetired || object.shape == nullptr ||
        object.shape->sites.empty()) {
      continue;
    }
    index->entries.push_back(MakeEntry(object, static_cast<uint32_t>(i)));
    index->origin_W += object.T_W_L.translation();
  }
  if (index->entries.empty()) return index;
  index->origin_W /= static_cast<double>(index->entries.size());
  IndexBuilder(*index).Build();
  return index;
}

}  // namespace clearance
