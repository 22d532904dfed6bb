#include "planner_demo/episode/truth.h"

#include <limits>
#include <utility>
#include <vector>

#include "planner_demo/sim/solid.h"

namespace clearance::demo {
namespace {

constexpr double kGround_m = 0.3;

class SceneTruth final : public Truth {
 public:
  explicit SceneTruth(const sim::Scene& scene) : movers_(scene.movers) {
    for (const sim::Solid& solid : scene.static_solids) {
      const Eigen::AlignedBox3d box = sim::Bounds(solid);
      if (box.max().z() > kGround_m) solids_.push_back({{solid}, box});
    }
    for (const sim::Mover& mover : movers_) {
      Eigen::AlignedBox3d box;
      for (const sim::Solid& solid : mover.solids) box.extend(sim::Bounds(solid));
      boxes_L_.push_back(box);
    }
  }

  double Distance(const Eigen::Vector3d& point_W, double time_s,
                  uint16_t* object_id) const override {
    double nearest_m = std::numeric_limits<double>::infinity();
    *object_id = 0;
    for (const auto& [solid, box] : solids_) {
      if (box.exteriorDistance(point_W) >= nearest_m) continue;
      nearest_m = std::min(nearest_m, sim::SignedDistance(solid, point_W));
    }
    for (size_t i = 0; i < movers_.size(); ++i) {
      const Eigen::Vector3d point_L = movers_[i].T_W_L(time_s).inverse() * point_W;
      if (boxes_L_[i].exteriorDistance(point_L) >= nearest_m) continue;
      const double distance_m = sim::SignedDistance(movers_[i].solids, point_L);
      if (distance_m < nearest_m) {
        nearest_m = distance_m;
        *object_id = movers_[i].id;
      }
    }
    return nearest_m;
  }

 private:
  std::vector<std::pair<std::vector<sim::Solid>, Eigen::AlignedBox3d>> solids_;
  std::vector<sim::Mover> movers_;
  std::vector<Eigen::AlignedBox3d> boxes_L_;
};

}  // namespace

std::unique_ptr<Truth> TruthOf(const sim::Scene& scene) {
  return std::make_unique<SceneTruth>(scene);
}

}  // namespace clearance::demo
