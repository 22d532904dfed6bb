// The surface of one rigid object as queries see it: sites with normals in L, in a box tree.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/core/aabb.h"

namespace clearance {

// A surface sample of an object: a small disc (surfel) about a sub-voxel site.
struct SurfaceSite {
  Eigen::Vector3f p_L;       // metres
  Eigen::Vector3f normal_L;  // unit, outwards
  float sigma_m = 0;
};

// Immutable once built; shared by every revision in which the object's surface did not change.
struct ObjectShape {
  double voxel_size_m = 0.1;
  Eigen::AlignedBox3f bounds_L;     // of the observed surface, empty when there is none
  std::vector<SurfaceSite> sites;   // in tree order
  // Box tree over `sites`, built by query/ (BuildObjectShape); layout private to query/object_tree.
  struct Node {
    float lower[3], upper[3];
    uint32_t first = 0;  // leaf: first site; inner: index of the left child (right = left + 1)
    uint32_t count = 0;  // leaf: number of sites; inner: 0
  };
  std::vector<Node> nodes;
};

}  // namespace clearance
