// What the static map remembers of the surface in one block, and whether a ray contradicts it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>

#include "server/map/surface_map.h"
#include "server/map/voxel.h"

namespace clearance {

// The stored surface near a voxel is the plane of its mean and its gradient, not its cube: a ray
// that grazes true ground passes through surface cubes without ever being behind that plane. Not
// thread-safe: neighbouring blocks are looked up when first needed.
class StoredSurface {
 public:
  StoredSurface() = default;
  StoredSurface(const SurfaceMap& map, const BlockIndex& block);

  bool empty() const { return mean_ == nullptr || weight_ == nullptr; }

  // Voxels with surface in the cube or behind it: a mean below 0.9 voxel (half a cube's diagonal).
  BlockMask HeldVoxels() const;

  float mean(int offset) const { return mean_[offset]; }
  float weight(int offset) const { return weight_[offset]; }

  // The voxels one step away. Weight 0 where nothing is stored.
  struct Voxel {
    float mean = 0, weight = 0;
    int block = 6, offset = 0;  // block: 0..5 beside this one (-x, +x, -y, ...), 6: this one
  };
  using Around = std::array<Voxel, 6>;  // -x, +x, -y, +y, -z, +z
  Around AroundOf(int offset);

  // Unit gradient of the mean in the map's frame. Zero where the neighbours do not tell, that is
  // where the mean does not change by about a metre a metre; differences above 1.5 voxels lie
  // across two surfaces and are left out.
  Eigen::Vector3f Normal(int offset) { return Normal(offset, AroundOf(offset)); }
  Eigen::Vector3f Normal(int offset, const Around& around) const;

 private:
  struct Leaf {
    const float* mean = nullptr;
    const float* weight = nullptr;
  };
  const Leaf& Neighbour(int n);  // looked up when first needed
  Voxel Across(int offset, int n);

  const SurfaceMap* map_ = nullptr;
  BlockIndex block_;
  const float* mean_ = nullptr;
  const float* weight_ = nullptr;
  float h_ = 0.1f;
  std::array<Leaf, 6> neighbours_{};  // -x, +x, -y, +y, -z, +z
  uint8_t looked_up_ = 0;             // bits of neighbours_
};

// From a voxel to the one that its stored surface lies in, by its mean and normal.
inline VoxelIndex SurfaceStep(float mean_voxels, const Eigen::Vector3f& normal) {
  const Eigen::Vector3f step = -mean_voxels * normal;
  return {static_cast<int>(std::lround(step.x())), static_cast<int>(std::lround(step.y())),
          static_cast<int>(std::lround(step.z()))};
}

// Whether contradicted surface goes at once, or waits for more. Each frame in a row without a
// return is a vote, and each ray of this frame, up to three: surface that returned rays in many
// frames needs half as many votes. `rays` of this frame were surely behind the surface; `doubts`
// went through clutter without a direction, or came out behind the surface later and may have
// passed beside: they count when there are three, when there were some before, or where no
// ray ever returned and one frame at most spoke for the surface. `own` holds the band, `site` the
// surface (SurfaceStep away).
bool IsRefuted(const SurfaceMap& map, const VoxelIndex& own, const VoxelIndex& site, int rays,
               int doubts);

// How far a ray has to be behind the stored plane to contradict it, in voxels.
inline constexpr float kPenetrationVoxels = 0.5f;
// How far behind the plane the voxel is that must not be free, in voxels.
inline constexpr float kInsideVoxels = 1.25f;

}  // namespace clearance
