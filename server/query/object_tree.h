// One object's surfels in a box tree: signed distance to them in the object's own frame.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "server/map/object_shape.h"

namespace clearance {

// Radius of the disc that a site stands for, in voxels: half the spacing of sites, so that discs of
// one surface meet without reaching far past its edges.
inline constexpr float kSurfelRadiusVoxels = 0.5f;

// The shape that queries read: sites in tree order, bounds of their discs. Deterministic. Sites
// with a value that is not finite are left out.
std::shared_ptr<const ObjectShape> BuildObjectShape(std::vector<SurfaceSite> sites,
                                                    double voxel_size_m);

// Distance from a point to a surfel's disc, and the unit direction from the disc to the point (the
// normal where the point lies on the disc).
struct SurfelDistance {
  float distance_m = 0;
  float height_m = 0;  // along the normal: < 0 behind the surfel
};
SurfelDistance DistanceToSurfel(const SurfaceSite& site, float radius_m,
                                const Eigen::Vector3f& p_L);
Eigen::Vector3f DirectionFromSurfel(const SurfaceSite& site, float radius_m,
                                    const Eigen::Vector3f& p_L);

// The surfel nearest to `p_L`, ties by the lower site index; `site` is -1 when none is nearer than
// or at `limit_m`. `seed`: a site that may be near, such as the last point's; it changes the time
// only.
struct NearestSurfel {
  int site = -1;
  float distance_m = 0;  // >= 0
};
NearestSurfel FindNearestSurfel(const ObjectShape& shape, const Eigen::Vector3f& p_L, float limit_m,
                                int seed = -1);

// Whether a point lies inside: within the shape's bounds and behind the surfels that are nearest,
// by a vote of all surfels up to one voxel farther than the nearest, which outvotes stray normals.
// Space behind the observed part of a shell is inside; an object seen from one side only has no
// inside beyond its bounds.
bool IsInside(const ObjectShape& shape, const Eigen::Vector3f& p_L, float nearest_m);

}  // namespace clearance
