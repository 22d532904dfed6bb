#include "planner_demo/sim/scenes/crossing_town.h"

#include <numbers>

#include "planner_demo/sim/bodies.h"

namespace clearance::sim {

Eigen::Isometry3d QuarterTurns(int count) {
  return Upright(Eigen::Vector3d::Zero(), count * std::numbers::pi / 2.0);
}

void AddCrossingTown(Random& random, Scene& scene) {
  auto& solids = scene.static_solids;
  const auto add = [&solids](const std::vector<Solid>& more) {
    solids.insert(solids.end(), more.begin(), more.end());
  };
  solids.push_back(MakeBox({-150.0, -150.0, -1.0}, {150.0, 150.0, 0.0}));
  for (int corner = 0; corner < 4; ++corner) {
    std::vector<Solid> quarter;
    const auto put = [&quarter](const std::vector<Solid>& more) {
      quarter.insert(quarter.end(), more.begin(), more.end());
    };
    const double side = 70.0;
    quarter.push_back(
        MakeBox({kRoadHalfWidth_m, kRoadHalfWidth_m, -0.5}, {side, side, kKerbHeight_m}));
    // Buildings along both roads, set back, with gaps between them.
    for (const bool along_x : {true, false}) {
      double from = along_x ? random.Uniform(11.0, 13.0) : random.Uniform(24.0, 27.0);
      while (from < 60.0) {
        const double to = from + random.Uniform(8.0, 16.0);
        const double front = random.Uniform(10.5, 12.5);
        const double back = front + random.Uniform(7.0, 10.0);
        const double height = random.Uniform(6.0, 12.0);
        quarter.push_back(along_x ? MakeBox({from, front, 0.0}, {to, back, height})
                                  : MakeBox({front, from, 0.0}, {back, to, height}));
        from = to + random.Uniform(1.0, 4.0);
      }
    }
    for (double at = 16.0; at < 60.0; at += random.Uniform(9.0, 14.0)) {
      put(MakeTree({at, 7.0, kKerbHeight_m}, random));
      put(MakeTree({7.0, at + 3.0, kKerbHeight_m}, random));
    }
    put(MakeLamp({5.2, 9.5, kKerbHeight_m}));
    quarter.push_back(MakeUprightCylinder({9.5, 5.2, kKerbHeight_m}, 0.1, 3.2));
    quarter.push_back(MakeBox({9.2, 4.9, 2.6}, {9.8, 5.5, 3.4}));
    add(Placed(quarter, QuarterTurns(corner)));
  }
}

}  // namespace clearance::sim
