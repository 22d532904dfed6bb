// What is really there, at any time: for the judge alone, never for a planner.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "planner_demo/sim/scene.h"

namespace clearance::demo {

class Truth {
 public:
  virtual ~Truth() = default;
  // Distance in metres from a point to the nearest surface at a time, negative inside; what a robot
  // drives on does not count. The nearest object's id (0: static) goes to `object_id`.
  virtual double Distance(const Eigen::Vector3d& point_W, double time_s,
                          uint16_t* object_id) const = 0;
};

// Of a simulated scene; solids that end below 0.3 m are ground.
std::unique_ptr<Truth> TruthOf(const sim::Scene& scene);

// Of a recording's gt/ folder: meshes, and poses that go on after the last frame. Distances to
// triangles, without a sign; triangles below 0.3 m are ground. NOT_FOUND, DATA_LOSS naming the
// file.
absl::StatusOr<std::unique_ptr<Truth>> ReadTruth(const std::string& folder);

}  // namespace clearance::demo
