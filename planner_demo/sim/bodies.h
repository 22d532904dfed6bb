#pragma once

#include <vector>

#include "planner_demo/sim/random.h"
#include "planner_demo/sim/solid.h"

namespace clearance::sim {

// Bodies in their own frame: x forward, y left, z up, origin on the ground below the centre. Sizes
// vary with `random`.
struct Body {
  const char* class_name;
  std::vector<Solid> solids;
  double half_length_m;
  double half_width_m;
};

Body MakeCar(Random& random);
Body MakeVan(Random& random);
Body MakeTruck(Random& random);
Body MakeCyclist(Random& random);
Body MakePedestrian(Random& random);
// Mostly cars, some vans and trucks.
Body MakeVehicle(Random& random);

// Street furniture, standing on `foot_W`.
std::vector<Solid> MakeTree(const Eigen::Vector3d& foot_W, Random& random);
std::vector<Solid> MakeLamp(const Eigen::Vector3d& foot_W);

// The solids of a body placed at T_W_B.
std::vector<Solid> Placed(const std::vector<Solid>& solids, const Eigen::Isometry3d& T_W_B);

}  // namespace clearance::sim
