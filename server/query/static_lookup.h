// Distance to the static surface at points off the grid, from the closest-site field.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

#include "server/map/distance_field.h"

namespace clearance {

// What the static map says of one point. `distance_voxels` and `gradient_W` are meaningful only
// with has_site. `state` is the attribute bits 0-2 of the point's own voxel (VoxelState, low
// confidence).
struct StaticAnswer {
  float distance_voxels = 0;                             // signed
  Eigen::Vector3f gradient_W = Eigen::Vector3f::Zero();  // unit, of the signed distance, or zero
  uint8_t sigma_code = 0;                                // of the deciding site
  uint8_t state = 0;
  bool has_site = false;
};

// Points are answered in groups: the blocks of one are fetched while others are computed.
inline constexpr int kLookupGroup = 16;

// Reads one field for many points. Holds only a cache; cheap to make, not shared between threads.
class StaticLookup {
 public:
  explicit StaticLookup(const DistanceField& field);

  // Answers `count` <= kLookupGroup consecutive columns. Every coordinate divided by the voxel size
  // must be within +-2^30 (see IsAddressable).
  //
  // Far from surfaces: the smallest distance to the sites of the eight voxel centres around the
  // point; sign from the centres. Nearer than 1.5 voxels: trilinear blend of the centres' signed
  // distances to their surfels (discs of half a voxel about the site, so that a plane is met
  // between the sites too); the two pass into one another up to 2.5 voxels.
  void Answer(const Eigen::Vector3d* points_W, int count, StaticAnswer* answers);

  bool IsAddressable(const Eigen::Vector3d& point_W) const {
    // Written so that NaN fails; without branches.
    return (std::abs(point_W.x()) < limit_m_) & (std::abs(point_W.y()) < limit_m_) &
           (std::abs(point_W.z()) < limit_m_);
  }

 private:
  const DistanceField::Region* FindRegion(const BlockIndex& region) {
    if (!cached_ || cached_key_ != region) {
      cached_region_ = field_.FindRegion(region);
      cached_key_ = region;
      cached_ = true;
    }
    return cached_region_;
  }

  const DistanceField& field_;
  double limit_m_;
  BlockIndex cached_key_;
  const DistanceField::Region* cached_region_ = nullptr;
  bool cached_ = false;
};

}  // namespace clearance
