#include "tests/query/check_oracle.h"

#include <algorithm>
#include <cmath>

#include "server/query/point_query.h"

namespace clearance::testing {
namespace {

double YardDistance(const Eigen::Vector3d& p) {
  const auto box = [&p](const Eigen::Vector3d& centre, const Eigen::Vector3d& half) {
    const Eigen::Vector3d q = (p - centre).cwiseAbs() - half;
    return q.cwiseMax(0).norm() + std::min(0.0, q.maxCoeff());
  };
  const double pole = std::hypot(p.x() - 2.13, p.y() + 1.71) - 0.25;
  return std::min({p.z() + 1.63, box({-3.2, 1.1, 0}, {0.5, 2.0, 5}),
                   box({1.0, 4.0, -1.0}, {2.5, 0.35, 0.8}), pole,
                   (p - Eigen::Vector3d(4.2, 0.9, 0.3)).norm() - 0.8});
}

void ForgetBalls(const Eigen::Vector3d& centre_W, std::mt19937& rng, DistanceField* field) {
  std::vector<std::pair<Eigen::Vector3d, double>> balls;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d reach(6, 6, 1.5);
    balls.emplace_back(centre_W + RandomIn({-reach, reach}, rng), 0.5 + 0.2 * i);
  }
  std::vector<std::pair<BlockIndex, std::shared_ptr<const FieldBlock>>> changed;
  field->ForEach(
      [&](const BlockIndex& index, const std::shared_ptr<const FieldBlock>& block, uint8_t) {
        auto copy = std::make_shared<FieldBlock>(*block);
        for (int i = 0; i < kBlockVoxels; ++i) {
          const Eigen::Vector3d p_W = VoxelCentre(VoxelAt(index, i), field->voxel_size_m());
          for (const auto& [ball_W, radius_m] : balls) {
            if ((p_W - ball_W).norm() < radius_m) copy->voxels[i].attributes &= ~uint16_t{3};
          }
        }
        changed.emplace_back(index, copy);
      });
  for (const auto& [index, block] : changed) field->Set(index, block);
}

Pose PoseAt(const RobotPath& path, double horizon_s) {
  if (path.T_W_R.size() == 1) return path.T_W_R[0];
  size_t i = 0;
  while (i + 2 < path.T_W_R.size() && horizon_s > path.horizons_s[i + 1]) ++i;
  const double share = std::clamp(
      (horizon_s - path.horizons_s[i]) / (path.horizons_s[i + 1] - path.horizons_s[i]), 0.0, 1.0);
  const Pose &a = path.T_W_R[i], &b = path.T_W_R[i + 1];
  Pose T_W_R = Pose::Identity();
  T_W_R.translation() = (1 - share) * a.translation() + share * b.translation();
  T_W_R.linear() = Eigen::Quaterniond(a.linear())
                       .slerp(share, Eigen::Quaterniond(b.linear()))
                       .toRotationMatrix();
  return T_W_R;
}

QueryOptions OptionsOf(const CheckOptions& options) {
  QueryOptions query;
  query.layers = options.layers;
  query.sigma_margin = options.sigma_margin;
  query.unknown_distances = options.unknown_as_occupied;
  return query;
}

double Least(const DistanceBatch& batch, size_t i) {
  const double distance_m = batch.distances_m[i];
  return batch.unknown_distances_m.empty()
             ? distance_m
             : std::min<double>(distance_m, batch.unknown_distances_m[i]);
}

}  // namespace

MapView Yard(const Eigen::Vector3d& centre_W, int objects, uint32_t seed) {
  std::mt19937 rng(seed);
  const Eigen::Vector3d half(7, 7, 2);
  DistanceField field =
      ExactField([&](const Eigen::Vector3d& p) { return YardDistance(p - centre_W); },
                 {centre_W - half, centre_W + half}, kCheckVoxel_m, kCheckReach_m);
  ForgetBalls(centre_W, rng, &field);
  MapView view = ViewOf(std::move(field), kCheckReach_m);
  view.config.max_horizon_s = 5;
  const auto shape = CarShape(0.2);
  std::normal_distribution<double> normal;
  for (int i = 0; i < objects; ++i) {
    Pose T_W_L = RandomPose(rng(), 0);
    const Eigen::Vector3d reach(6, 6, 0.5);
    T_W_L.translation() = centre_W + RandomIn({-reach, reach}, rng);
    ObjectView& object = AddObject(view, static_cast<uint16_t>(i + 1), shape, T_W_L);
    const Eigen::Vector3d velocity(3 * normal(rng), 3 * normal(rng), 0.2 * normal(rng));
    const Eigen::Vector3d spin(0.1 * normal(rng), 0.1 * normal(rng), 0.8 * normal(rng));
    object.screw_W.head<3>() = velocity - spin.cross(Eigen::Vector3d(T_W_L.translation()));
    object.screw_W.tail<3>() = spin;
    object.position_sigma_m = 0.02;
    object.velocity_sigma_mps = 0.05 * std::abs(normal(rng));
  }
  view.object_index = BuildObjectIndex(view.objects);
  return view;
}

std::vector<RobotSphere> RandomRobot(std::mt19937& rng) {
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<RobotSphere> spheres(1 + rng() % 6);
  const Eigen::Vector3d reach(0.5, 0.5, 0.3);
  for (RobotSphere& sphere : spheres) {
    if (spheres.size() > 1) sphere.centre_R = RandomIn({-reach, reach}, rng);
    sphere.radius_m = 0.05 + 0.3 * unit(rng);
  }
  return spheres;
}

RobotPath RandomPath(const Eigen::Vector3d& centre_W, std::mt19937& rng) {
  std::uniform_real_distribution<double> unit(0, 1);
  RobotPath path;
  const size_t poses = 2 + rng() % 3;
  const Eigen::Vector3d reach(6.2, 6.2, 1.2);
  Eigen::Vector3d at = RandomIn({-reach, reach}, rng);
  double horizon_s = unit(rng);
  // Some dash through the yard, some hardly move.
  const double scale = std::pow(10.0, -2 * unit(rng));
  for (size_t i = 0; i < poses; ++i) {
    Pose T_W_R = RandomPose(rng(), 0);
    T_W_R.translation() = centre_W + at;
    path.T_W_R.push_back(T_W_R);
    path.horizons_s.push_back(horizon_s);
    horizon_s += 1e-3 + unit(rng);
    at += scale * (RandomIn({-reach, reach}, rng) - at);
  }
  return path;
}

StateOracle AskState(const MapView& view, const std::vector<RobotSphere>& spheres,
                     const RobotPath& path, double horizon_s, const CheckOptions& options) {
  const Pose T_W_R = PoseAt(path, horizon_s);
  Eigen::Matrix3Xd points_W(3, spheres.size());
  for (size_t s = 0; s < spheres.size(); ++s) points_W.col(s) = T_W_R * spheres[s].centre_R;
  QueryOptions query = OptionsOf(options);
  query.horizon_s = horizon_s;
  const DistanceBatch batch = QueryDistances(view, points_W, query);
  StateOracle state{.clearance_m = 1e9};
  for (size_t s = 0; s < spheres.size(); ++s) {
    const double clearance_m = Least(batch, s) - spheres[s].radius_m;
    state.clearance_m = std::min(state.clearance_m, clearance_m);
    state.collides |= clearance_m < options.margin_m;
  }
  return state;
}

PathOracle SamplePath(const MapView& view, const std::vector<RobotSphere>& spheres,
                      const RobotPath& path, const CheckOptions& options) {
  double arm_m = 0;
  for (const RobotSphere& sphere : spheres) arm_m = std::max(arm_m, sphere.centre_R.norm());
  std::vector<double> times_s = {path.horizons_s[0]};
  for (size_t i = 0; i + 1 < path.T_W_R.size(); ++i) {
    const Pose &a = path.T_W_R[i], &b = path.T_W_R[i + 1];
    const double travel_m =
        (a.translation() - b.translation()).norm() +
        arm_m * Eigen::Quaterniond(a.linear()).angularDistance(Eigen::Quaterniond(b.linear()));
    const double duration_s = path.horizons_s[i + 1] - path.horizons_s[i];
    const int steps = 1 + static_cast<int>(std::max(travel_m / 1e-3, duration_s / 1e-3));
    for (int k = 1; k <= steps; ++k) {
      times_s.push_back(path.horizons_s[i] + duration_s * k / steps);
    }
  }
  PathOracle oracle;
  oracle.min_clearance_m = 1e9;
  const size_t n = spheres.size();
  // In pieces, so that an early collision costs little.
  constexpr size_t kPiece = 512;
  for (size_t begin = 0; begin < times_s.size(); begin += kPiece) {
    const size_t end = std::min(begin + kPiece, times_s.size());
    Eigen::Matrix3Xd points_W(3, (end - begin) * n);
    QueryOptions query = OptionsOf(options);
    query.parallel = false;
    for (size_t i = begin; i < end; ++i) {
      const Pose T_W_R = PoseAt(path, times_s[i]);
      for (size_t s = 0; s < n; ++s) {
        points_W.col((i - begin) * n + s) = T_W_R * spheres[s].centre_R;
        query.horizons_s.push_back(static_cast<float>(times_s[i]));
      }
    }
    const DistanceBatch batch = QueryDistances(view, points_W, query);
    for (size_t i = begin; i < end; ++i) {
      bool collides = false;
      for (size_t s = 0; s < n; ++s) {
        const double clearance_m = Least(batch, (i - begin) * n + s) - spheres[s].radius_m;
        collides |= clearance_m < options.margin_m;
        if (clearance_m >= oracle.min_clearance_m) continue;
        oracle.min_clearance_m = clearance_m;
        oracle.min_distance_m = clearance_m + spheres[s].radius_m;
      }
      if (!collides) continue;
      oracle.collision_s = times_s[i];
      oracle.step_s = i > 0 ? times_s[i] - times_s[i - 1] : 0;
      return oracle;
    }
  }
  return oracle;
}

}  // namespace clearance::testing
