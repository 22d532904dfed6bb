// A scene with moving objects, random robots and paths, and dense sampling of the query itself.
#pragma once

#include <optional>
#include <random>
#include <vector>

#include "server/query/trajectory_check.h"
#include "tests/query/query_fixture.h"

namespace clearance::testing {

inline constexpr double kCheckVoxel_m = 0.2;
inline constexpr double kCheckReach_m = 2.0;

// A yard of 14 x 14 x 4 m about `centre_W` with walls, a pole, a ball, patches of unknown space and
// `objects` cars on screws of their own. Nothing is known outside.
MapView Yard(const Eigen::Vector3d& centre_W, int objects, uint32_t seed);

// Up to four balls, and a path of two to four poses through the yard in up to 3 s.
std::vector<RobotSphere> RandomRobot(std::mt19937& rng);
RobotPath RandomPath(const Eigen::Vector3d& centre_W, std::mt19937& rng);

// Clearance of every ball at one time, straight from QueryDistances.
struct StateOracle {
  double clearance_m = 0;  // of the worst ball
  bool collides = false;
};
StateOracle AskState(const MapView& view, const std::vector<RobotSphere>& spheres,
                     const RobotPath& path, double horizon_s, const CheckOptions& options);

// The path in steps of at most a millimetre of any ball's centre and a millisecond.
struct PathOracle {
  std::optional<double> collision_s;  // of the first sample that collides
  double step_s = 0;                  // to the sample before it
  double min_clearance_m = 0;         // over the samples up to it
  double min_distance_m = 0;          // clearance and radius there
};
PathOracle SamplePath(const MapView& view, const std::vector<RobotSphere>& spheres,
                      const RobotPath& path, const CheckOptions& options);

}  // namespace clearance::testing
