// The surface of one rigid object as queries see it: sites with normals in L, in a box tree.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "server/core/aabb.h"

namespace clearance {

// A surface sample of an object: a small disc (surfel) about a sub-voxel site.
struct SurfaceSite {
  Eigen::Vector3f p_L;       // metres
  Eigen::Vector3f normal_L;  // unit, outwards
  float sigma_m = 0;
};

// Built and read by query/ (BuildObjectShape).
struct SurfelTree;

// Immutable once built; shared by every revision in which the object's surface did not change.
struct ObjectShape {
  double voxel_size_m = 0.1;
  Eigen::AlignedBox3f bounds_L;    // of the observed surface, empty when there is none
  std::vector<SurfaceSite> sites;  // in tree order
  float max_sigma_m = 0;           // largest of the sites
  std::shared_ptr<const SurfelTree> tree;
};

}  // namespace clearance
