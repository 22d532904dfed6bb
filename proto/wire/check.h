// Requests about robots, regions and pins as plain structs, all checks of the contract done that
// need no map.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "clearance/v1/query.pb.h"
#include "proto/wire/query.h"
#include "server/core/pose.h"

namespace clearance::wire {

struct CheckLimits {
  QueryLimits query;
  size_t max_trajectories = 10'000;
  size_t max_waypoints = 100'000;  // of all trajectories, or poses
  size_t max_spheres = 1'000;
  size_t max_states = 2'000'000;  // waypoints times spheres
};

// A ball in the robot's frame R.
struct Ball {
  Eigen::Vector3d centre_R;
  double radius_m;  // > 0
};

struct CheckSettings {
  QuerySettings settings;  // fusion and max_distance_m unused; the time is the reference
  std::vector<Ball> spheres;
  double margin_m = 0;
  bool unknown_as_free = false;
};

struct TimedPath {
  std::vector<Pose> T_W_R;      // at least one
  std::vector<double> times_s;  // one each, strictly ascending
};

struct TrajectoriesQuery {
  CheckSettings check;
  std::vector<TimedPath> trajectories;
};

struct SpheresQuery {
  CheckSettings check;
  std::vector<Pose> T_W_R;      // at least one
  std::vector<double> times_s;  // one each, or none
};

struct RegionQuery {
  QuerySettings settings;
  Aabb bounds;
  double resolution_m = 0;  // 0: the voxel size
  bool gradients = false, objects = false, known_only = false;
};

struct PinQuery {
  QuerySettings settings;  // map and consistency count
  uint64_t revision = 0;   // 0: the newest
  double ttl_s = 0;        // 0: the server's default
};

// Errors: INVALID_ARGUMENT naming field, index, got and expected: empty or too large batches,
// lengths, values that are not finite, quaternions that are not of unit length, radii not above 0,
// times that do not ascend, unknown enum values, negative margins.
absl::StatusOr<TrajectoriesQuery> TrajectoriesQueryFromProto(
    const v1::CheckTrajectoriesRequest& request, const CheckLimits& limits = {});
absl::StatusOr<SpheresQuery> SpheresQueryFromProto(const v1::CheckSpheresRequest& request,
                                                   const CheckLimits& limits = {});
absl::StatusOr<RegionQuery> RegionQueryFromProto(const v1::GetRegionRequest& request,
                                                 const QueryLimits& limits = {});
absl::StatusOr<PinQuery> PinQueryFromProto(const v1::PinRevisionRequest& request,
                                           const QueryLimits& limits = {});

}  // namespace clearance::wire
