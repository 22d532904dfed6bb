// One point's answer: static map and objects become one distance, one state, one gradient.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "server/map/map_view.h"
#include "server/query/object_index.h"
#include "server/query/object_query.h"
#include "server/query/query_options.h"
#include "server/query/static_lookup.h"
#include "server/query/unknown_distance.h"

namespace clearance {

// Answers columns of one batch. Holds caches; one for each thread. What is passed to the
// constructor outlives it.
class PointAnswerer {
 public:
  PointAnswerer(const MapView& view, const ObjectIndex& index, const std::vector<uint8_t>& enabled,
                const QueryOptions& options);

  // Fills columns [begin, end) of the batch's arrays, which are allocated.
  void Answer(const Eigen::Matrix3Xd& points_W, Eigen::Index begin, Eigen::Index end,
              DistanceBatch* batch);

 private:
  // The answer in the making. `score_m` is the distance less the margin; nothing found = the
  // maximum.
  struct Combined {
    float score_m = 0;
    float sigma_m = 0;
    Eigen::Vector3f gradient_W = Eigen::Vector3f::Zero();
    int entry = -1;      // deciding object, -1 = static or none
    bool found = false;  // something is nearer than the maximum
  };

  void AnswerOne(const Eigen::Vector3d& p_W, const StaticAnswer& of_static, Eigen::Index column,
                 DistanceBatch* batch);
  Combined FromStatic(const StaticAnswer& of_static) const;
  void TakeNearest(const Eigen::Vector3d& p_W, double horizon_s, Combined* combined);
  void TakeWeighted(const Eigen::Vector3d& p_W, double horizon_s, Combined* combined);
  uint8_t State(const Eigen::Vector3d& p_W, const StaticAnswer& of_static, double horizon_s,
                float score_m);
  bool ObjectCovers(const Eigen::Vector3d& p_W, double horizon_s, bool* low_confidence);
  double HorizonOf(Eigen::Index column) const;
  void Write(const Combined& combined, uint8_t state, Eigen::Index column, DistanceBatch* batch);

  const MapView& view_;
  const ObjectIndex& index_;
  const QueryOptions& options_;
  StaticLookup lookup_;
  ObjectQuery objects_;
  ObjectQuery covering_;  // without margin
  UnknownSearch unknown_;
  float voxel_size_m_;
  float max_distance_m_;
  float sigma_margin_;
  bool with_static_;
  bool with_objects_;
  uint8_t common_flags_ = 0;
  std::array<float, 32> sigma_of_code_m_;
  std::vector<ObjectAnswer> scratch_;
};

}  // namespace clearance
