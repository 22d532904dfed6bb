// The nearest object at a point and a time, by branch and bound that never drops one.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/map/map_view.h"
#include "server/query/object_index.h"
#include "server/query/query_options.h"

namespace clearance {

// What one object says of a point.
struct ObjectAnswer {
  float distance_m = 0;  // signed
  float sigma_m = 0;     // of the surfel and of the object's pose at the horizon
  Eigen::Vector3f gradient_W = Eigen::Vector3f::Zero();  // unit, of the signed distance
  uint32_t entry = 0;                                    // in the index
};

// One flag an entry of the index: whether the selection lets it count. Empty = all.
std::vector<uint8_t> EnabledEntries(const ObjectIndex& index, const LayerSelection& layers);

// Standard deviation of a distance to a surfel of an object carried `horizon_s` ahead: the surfel's
// own, and the pose's, which grows linearly.
float ObjectSigma(const ObjectIndex::Entry& entry, float site_sigma_m, double horizon_s);

// Signed distance to one object whose pose is given by the rotation into L and the origin of L in
// W: exactly what the tree search returns, surfel by surfel. `limit_m` bounds the search outside
// the object's box; false when nothing is nearer or as near.
bool AskObject(const ObjectIndex::Entry& entry, const Eigen::Matrix3d& R_L_W,
               const Eigen::Vector3d& t_W_L, const Eigen::Vector3d& p_W, double horizon_s,
               float limit_m, ObjectAnswer* answer, int* nearest_site = nullptr);

// Reads one index for many points; keeps the objects' poses at the last horizon asked. Not shared
// between threads.
class ObjectQuery {
 public:
  // `enabled`: one flag an entry of the index, empty = all. Both outlive the query.
  ObjectQuery(const ObjectIndex& index, const std::vector<uint8_t>& enabled, float sigma_margin);

  // The object with the smallest distance - sigma_margin * sigma at `horizon_s`, where that is less
  // than `limit_m`; ties by the lower id. Exactly the minimum over all enabled objects.
  bool Nearest(const Eigen::Vector3d& p_W, double horizon_s, float limit_m, ObjectAnswer* answer);

  // Every enabled object with a surface nearer than `limit_m`, or around the point, in the order of
  // the tree. Replaces the contents of `answers`.
  void Within(const Eigen::Vector3d& p_W, double horizon_s, float limit_m,
              std::vector<ObjectAnswer>* answers);

 private:
  struct Posed {
    double horizon_s = 0;
    Eigen::Matrix3d R_L_W;
    Eigen::Vector3d t_W_L;
  };

  bool Ask(uint32_t entry, const Eigen::Vector3d& p_W, double horizon_s, float limit_m,
           ObjectAnswer* answer);
  template <typename Limit, typename Visit>
  void Traverse(const Eigen::Vector3d& p_W, double horizon_s, Limit limit, Visit visit);

  const ObjectIndex& index_;
  const std::vector<uint8_t>& enabled_;
  float sigma_margin_;
  std::vector<Posed> posed_;        // by entry, filled on demand; empty until a horizon is asked
  std::vector<int> nearest_sites_;  // by entry: the last answer, where the next search starts
};

}  // namespace clearance
