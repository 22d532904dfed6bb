// Whether a robot made of balls can follow a timed path through one view of the map.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "server/core/pose.h"
#include "server/map/map_view.h"
#include "server/query/query_options.h"

namespace clearance {

// A ball in the robot's frame R, metres; radius > 0.
struct RobotSphere {
  Eigen::Vector3d centre_R = Eigen::Vector3d::Zero();
  double radius_m = 0;
};

// A timed path: position linear and orientation slerp between the poses.
struct RobotPath {
  std::vector<Pose> T_W_R;         // at least one
  std::vector<double> horizons_s;  // one a pose, strictly ascending, seconds after the view's stamp
};

struct CheckOptions {
  double margin_m = 0;              // a ball collides below radius + margin
  bool unknown_as_occupied = true;  // unknown space counts as a surface
  double sigma_margin = 0;          // distances are reduced by this many sigmas
  LayerSelection layers{};
  std::function<bool()> cancelled{};  // asked now and then; true ends the work, results are void
};

// The outcome for one path; times are horizons.
struct PathCheck {
  bool collides = false;
  double first_collision_s = 0;              // where it collides
  std::optional<double> last_valid_s;        // absent: the first state collides
  std::optional<uint32_t> last_valid_index;  // the last pose at or before last_valid_s
  double min_clearance_m = 0;  // least distance minus radius up to the collision or the end
  double min_clearance_s = 0;
  int object = -1;  // what is nearest there: index in view.objects, -1 = static or nothing
  Twist twist;      // of that object then; zero without one
  bool unknown_decides = false;  // unknown space is nearer there than any surface
};

// One entry a pose.
struct PoseChecks {
  std::vector<uint8_t> collides;         // 1 or 0
  std::vector<float> clearances_m;       // distance minus radius of the worst ball
  std::vector<uint32_t> sphere_indices;  // that ball, the first of equals
  std::vector<int> objects;  // nearest to it: index in view.objects, -1 = static or nothing
};

// Limits of one call that bound what it can cost.
struct CheckLimits {
  size_t max_paths = 10'000;
  size_t max_poses = 100'000;  // of all paths
  size_t max_spheres = 1'000;
  size_t max_states = 2'000'000;  // poses times balls
  // Of all paths, the way of every ball added up: nearer than a voxel to something, every
  // millimetre of it may cost a look-up.
  double max_travel_m = 1'000'000;
};

// INVALID_ARGUMENT, OUT_OF_RANGE (a horizon before 0 or beyond config.max_horizon_s) or NOT_FOUND
// (an object that the view does not have), naming field, index, got and limit.
absl::Status ValidateCheck(const MapView& view, const std::vector<RobotSphere>& spheres,
                           const std::vector<RobotPath>& paths, const CheckOptions& options,
                           const CheckLimits& limits = {});
// The same for poses at their horizons: one each, or empty = all at 0.
absl::Status ValidateCheck(const MapView& view, const std::vector<RobotSphere>& spheres,
                           const std::vector<Pose>& T_W_R, const std::vector<double>& horizons_s,
                           const CheckOptions& options, const CheckLimits& limits = {});

// What is checked is the distance that QueryDistances reports (with Fusion::kMin), and with
// unknown_as_occupied the distance to the nearest unknown voxel: a state collides where the smaller
// of the two is below radius + margin.
//
// By conservative advancement: an interval of the path counts as free only when bounds on the
// distance and on the relative motion of ball and obstacles, each object's own, leave no room for a
// collision; other intervals are halved down to a millimetre and a millisecond. So at any speed no
// collision that is at least that long is missed, and the first one is found within that step.
// `min_clearance_m` is the reported value at `min_clearance_s`; none along the path is less by
// more than 2 mm plus 1 % of the distance plus the field's interpolation error (half a voxel at
// most, where the distance is above a voxel from collision).
//
// The inputs are valid. Pure; any number of threads may ask the same view.
std::vector<PathCheck> CheckPaths(const MapView& view, const std::vector<RobotSphere>& spheres,
                                  const std::vector<RobotPath>& paths,
                                  const CheckOptions& options = {});

PoseChecks CheckPoses(const MapView& view, const std::vector<RobotSphere>& spheres,
                      const std::vector<Pose>& T_W_R, const std::vector<double>& horizons_s,
                      const CheckOptions& options = {});

}  // namespace clearance
