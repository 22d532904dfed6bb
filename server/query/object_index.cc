#include "server/query/object_index.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

namespace clearance {
namespace {

constexpr uint32_t kLeafEntries = 2;

ObjectIndex::Entry MakeEntry(const ObjectView& object, uint32_t index) {
  ObjectIndex::Entry entry;
  entry.R_L_W = object.T_W_L.linear().transpose();
  entry.t_W_L = object.T_W_L.translation();
  entry.screw_W = object.screw_W;
  entry.bounds_L = object.shape->bounds_L;
  entry.position_sigma_m = static_cast<float>(object.position_sigma_m);
  entry.velocity_sigma_mps = static_cast<float>(object.velocity_sigma_mps);
  for (const SurfaceSite& site : object.shape->sites) {
    entry.max_site_sigma_m = std::max(entry.max_site_sigma_m, site.sigma_m);
  }
  entry.object = index;
  entry.id = object.id;
  entry.life_state = object.life_state;
  entry.shape = object.shape;
  return entry;
}

Eigen::Array4f Padded(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()), 0.f};
}

// Bounds of one box now, of its velocities and of its acceleration: all three are extreme at
// corners, since a body's velocity is linear in the point and its length convex.
ObjectIndex::Node BoundsOf(const ObjectIndex::Entry& entry, const Eigen::Vector3d& origin_W) {
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
  ObjectIndex::Node node;
  node.lower = Padded(box.min());
  node.upper = Padded(box.max());
  node.v_lower = Padded(velocities.min());
  node.v_upper = Padded(velocities.max());
  node.acceleration_mps2 = static_cast<float>(acceleration);
  node.sigma_m = entry.max_site_sigma_m + entry.position_sigma_m;
  node.sigma_growth_mps = entry.velocity_sigma_mps;
  return node;
}

void Extend(ObjectIndex::Node& node, const ObjectIndex::Node& other) {
  node.lower = node.lower.min(other.lower);
  node.upper = node.upper.max(other.upper);
  node.v_lower = node.v_lower.min(other.v_lower);
  node.v_upper = node.v_upper.max(other.v_upper);
  node.acceleration_mps2 = std::max(node.acceleration_mps2, other.acceleration_mps2);
  node.sigma_m = std::max(node.sigma_m, other.sigma_m);
  node.sigma_growth_mps = std::max(node.sigma_growth_mps, other.sigma_growth_mps);
}

class IndexBuilder {
 public:
  explicit IndexBuilder(ObjectIndex& index) : index_(index), order_(index.entries.size()) {
    for (const ObjectIndex::Entry& entry : index.entries) {
      bounds_.push_back(BoundsOf(entry, index.origin_W));
    }
    std::iota(order_.begin(), order_.end(), 0u);
  }

  void Build() {
    index_.nodes.resize(1);
    Split(0, 0, static_cast<uint32_t>(order_.size()));
    std::vector<ObjectIndex::Entry> sorted;
    sorted.reserve(order_.size());
    for (uint32_t i : order_) sorted.push_back(std::move(index_.entries[i]));
    index_.entries = std::move(sorted);
  }

 private:
  void Split(uint32_t node, uint32_t first, uint32_t count) {
    ObjectIndex::Node bounds = bounds_[order_[first]];
    Eigen::Array4f centre_low = Centre(order_[first]), centre_high = centre_low;
    for (uint32_t i = first + 1; i < first + count; ++i) {
      Extend(bounds, bounds_[order_[i]]);
      centre_low = centre_low.min(Centre(order_[i]));
      centre_high = centre_high.max(Centre(order_[i]));
    }
    bounds.first = first;
    bounds.count = count;
    if (count > kLeafEntries) {
      int axis;
      (centre_high - centre_low).maxCoeff(&axis);
      const auto begin = order_.begin() + first;
      const uint32_t half = count / 2;
      std::nth_element(begin, begin + half, begin + count, [&](uint32_t a, uint32_t b) {
        return std::pair(Centre(a)[axis], a) < std::pair(Centre(b)[axis], b);
      });
      bounds.first = static_cast<uint32_t>(index_.nodes.size());
      bounds.count = 0;
      index_.nodes.resize(bounds.first + 2);
      Split(bounds.first, first, half);
      Split(bounds.first + 1, first + half, count - half);
    }
    index_.nodes[node] = bounds;
  }

  Eigen::Array4f Centre(uint32_t i) const { return bounds_[i].lower + bounds_[i].upper; }

  ObjectIndex& index_;
  std::vector<uint32_t> order_;
  std::vector<ObjectIndex::Node> bounds_;
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
