// Where to go, and what a traffic code says about the place.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "planner_demo/plan/space_time.h"

namespace clearance::demo {

struct Mission {
  RobotState start;  // at rest
  Eigen::Vector3d goal_W = Eigen::Vector3d::Zero();
  double goal_radius_m = 0.6;
  Eigen::Vector3d min_W = Eigen::Vector3d::Zero(), max_W = Eigen::Vector3d::Zero();
  // Carriageways: robots may cross them and must not stop there. Others may stop anywhere.
  std::vector<Eigen::AlignedBox2d> no_standing;

  // Not on a carriageway, and no closer than `radius_m` to one.
  bool MayStand(const Eigen::Vector3d& position_W, double radius_m) const {
    for (const Eigen::AlignedBox2d& box : no_standing) {
      if (box.squaredExteriorDistance(position_W.head<2>()) <= radius_m * radius_m) return false;
    }
    return true;
  }
};

}  // namespace clearance::demo
