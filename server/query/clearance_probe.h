// The distance that decides about one ball at one time, and what it is a distance to.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <vector>

#include "server/map/map_view.h"
#include "server/query/object_index.h"
#include "server/query/object_query.h"
#include "server/query/query_options.h"
#include "server/query/static_lookup.h"
#include "server/query/unknown_distance.h"

namespace clearance {

struct ProbeAnswer {
  float distance_m = 0;  // exactly as QueryDistances reports it, with its sigma margin and clamp
  // To the nearest unknown voxel; exact where it is below distance_m and the limit of the search,
  // else some value not below the lesser of them. Where unknown space does not count: distance_m.
  float unknown_m = 0;
  // Where unknown space does not count: no voxel on the inner side of a surface is nearer.
  float inner_m = 0;
  int entry = -1;  // the object that decides distance_m, in the index; -1 = static or nothing

  float least_m() const { return unknown_m < distance_m ? unknown_m : distance_m; }
};

// Reads one view for many centres. Holds caches; one for each thread. What is passed to the
// constructor outlives it.
class ClearanceProbe {
 public:
  ClearanceProbe(const MapView& view, const ObjectIndex& index, const std::vector<uint8_t>& enabled,
                 const LayerSelection& layers, double sigma_margin, bool unknown_counts);

  // `objects`: false where none is within the maximum distance. `unknown_limit_m`: how far to
  // search for unknown space.
  ProbeAnswer At(const Eigen::Vector3d& p_W, double horizon_s, bool objects = true,
                 double unknown_limit_m = std::numeric_limits<double>::infinity());

  // Whether the eight voxels around the point lie on both sides of a surface: the sign of the
  // distance may then jump between them.
  bool OnBothSides(const Eigen::Vector3d& p_W) const;

  float max_distance_m() const { return max_distance_m_; }
  bool with_static() const { return with_static_; }
  bool with_objects() const { return with_objects_; }

 private:
  float InnerBound(const Eigen::Vector3d& p_W, float distance_m);

  const DistanceField& field_;
  StaticLookup lookup_;
  ObjectQuery objects_;
  UnknownSearch unknown_, inner_;
  float voxel_size_m_, max_distance_m_, sigma_margin_;
  bool with_static_, with_objects_, unknown_counts_;
  std::array<float, 32> sigma_of_code_m_;
};

}  // namespace clearance
