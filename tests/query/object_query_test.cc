// Many objects: culling against brute force, time, layers, margins, states.
#include "server/query/object_query.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "server/query/point_query.h"
#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

using state_byte::kLowConfidence;
using state_byte::kPredicted;
using state_byte::kStateMask;

constexpr double kVoxel = 0.1;
constexpr double kMax = 5.0;

MapView Crowd(int count, double half_m, const Eigen::Vector3d& centre_W, uint32_t seed) {
  MapView view = testing::ViewOf(DistanceField(kVoxel, kMax), kMax);
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal;
  const auto shape = testing::CarShape(0.2);
  const Eigen::Vector3d reach(half_m, half_m, 3);
  for (int i = 0; i < count; ++i) {
    Pose T_W_L = testing::RandomPose(rng(), 0);
    T_W_L.translation() = centre_W + testing::RandomIn({-reach, reach}, rng);
    ObjectView& object = testing::AddObject(view, static_cast<uint16_t>(1 + i), shape, T_W_L);
    const Eigen::Vector3d velocity(8 * normal(rng), 8 * normal(rng), normal(rng));
    const Eigen::Vector3d spin(0.1 * normal(rng), 0.1 * normal(rng), 0.5 * normal(rng));
    const Eigen::Vector3d origin = T_W_L.translation();
    object.screw_W.head<3>() = velocity - spin.cross(origin);
    object.screw_W.tail<3>() = spin;
    object.position_sigma_m = 0.05 * std::abs(normal(rng));
    object.velocity_sigma_mps = 0.2 * std::abs(normal(rng));
  }
  view.object_index = BuildObjectIndex(view.objects);
  return view;
}

// Every object asked, none skipped; the smallest distance less the margin wins, then the lower id.
struct Expected {
  float score_m = static_cast<float>(kMax);
  uint32_t id = 0;
  float sigma_m = 0;
};
Expected AskEveryObject(const MapView& view, const Eigen::Vector3d& p_W, double horizon_s,
                        float sigma_margin) {
  Expected best;
  for (const ObjectIndex::Entry& entry : view.object_index->entries) {
    const Pose H_W = ExpScrew(entry.screw_W * horizon_s);
    Eigen::Matrix3d R_L_W = entry.R_L_W;
    Eigen::Vector3d t_W_L = entry.t_W_L;
    if (horizon_s != 0) {
      R_L_W = entry.R_L_W * H_W.linear().transpose();
      t_W_L = H_W * entry.t_W_L;
    }
    ObjectAnswer answer;
    if (!AskObject(entry, R_L_W, t_W_L, p_W, horizon_s, std::numeric_limits<float>::max(),
                   &answer)) {
      continue;
    }
    const float score_m = answer.distance_m - sigma_margin * answer.sigma_m;
    const uint32_t id = entry.id.value();
    if (score_m < best.score_m || (score_m == best.score_m && id < best.id)) {
      best = {score_m, id, answer.sigma_m};
    }
  }
  best.score_m = std::max(best.score_m, -static_cast<float>(kMax));
  return best;
}

TEST(ObjectQuery, CulledEqualsBruteForceWithAThousandObjects) {
  for (const Eigen::Vector3d& centre_W :
       {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(-10'000, 10'000, 20)}) {
    const MapView view = Crowd(1000, 100, centre_W, 1);
    std::mt19937 rng(2);
    const Eigen::Vector3d reach(110, 110, 8);
    for (double horizon_s : {0.0, 0.3, 2.5}) {
      for (double margin : {0.0, 2.0}) {
        Eigen::Matrix3Xd points(3, 150);
        for (int i = 0; i < points.cols(); ++i) {
          points.col(i) = centre_W + testing::RandomIn({-reach, reach}, rng);
        }
        const DistanceBatch batch = QueryDistances(
            view, points,
            {.horizon_s = horizon_s, .objects = true, .sigmas = true, .sigma_margin = margin});
        for (int i = 0; i < points.cols(); ++i) {
          const Expected expected =
              AskEveryObject(view, points.col(i), horizon_s, static_cast<float>(margin));
          ASSERT_EQ(batch.distances_m[i], expected.score_m) << "horizon " << horizon_s;
          ASSERT_EQ(batch.object_ids[i], expected.id);
          ASSERT_EQ(batch.sigmas_m[i], expected.sigma_m);
        }
      }
    }
  }
}

TEST(ObjectQuery, BoundsHoldForAnyHorizonOfEachPoint) {
  const MapView view = Crowd(200, 60, Eigen::Vector3d(5, -7, 0), 3);
  std::mt19937 rng(4);
  std::uniform_real_distribution<float> seconds(0, 5);
  Eigen::Matrix3Xd points(3, 2000);
  QueryOptions options{.objects = true};
  for (int i = 0; i < points.cols(); ++i) {
    points.col(i) =
        testing::RandomIn({Eigen::Vector3d(-80, -80, -5), Eigen::Vector3d(80, 80, 5)}, rng);
    options.horizons_s.push_back(i % 7 == 0 ? 0.f : seconds(rng));
  }
  const DistanceBatch batch = QueryDistances(view, points, options);
  int predicted = 0;
  for (int i = 0; i < points.cols(); ++i) {
    const Expected expected = AskEveryObject(view, points.col(i), options.horizons_s[i], 0);
    ASSERT_EQ(batch.distances_m[i], expected.score_m);
    ASSERT_EQ(batch.object_ids[i], expected.id);
    const bool ahead = expected.id != 0 && options.horizons_s[i] > 0;
    EXPECT_EQ((batch.states[i] & kPredicted) != 0, ahead);
    predicted += ahead;
  }
  EXPECT_GT(predicted, 200);
}

TEST(ObjectQuery, AtAHorizonEqualsTheObjectCarriedThereByItsScrew) {
  const MapView now = Crowd(30, 20, Eigen::Vector3d(300, -200, 1), 5);
  MapView later = now;
  for (ObjectView& object : later.objects) {
    object.T_W_L = object.PoseAt(1.7);
    object.position_sigma_m += 1.7 * object.velocity_sigma_mps;
  }
  later.object_index = BuildObjectIndex(later.objects);
  std::mt19937 rng(6);
  Eigen::Matrix3Xd points(3, 500);
  for (int i = 0; i < points.cols(); ++i) {
    points.col(i) =
        testing::RandomIn({Eigen::Vector3d(270, -230, -3), Eigen::Vector3d(330, -170, 5)}, rng);
  }
  const DistanceBatch a =
      QueryDistances(now, points, {.horizon_s = 1.7, .gradients = true, .sigmas = true});
  const DistanceBatch b = QueryDistances(later, points, {.gradients = true, .sigmas = true});
  for (int i = 0; i < points.cols(); ++i) {
    EXPECT_NEAR(a.distances_m[i], b.distances_m[i], 1e-5);
    EXPECT_NEAR(a.sigmas_m[i], b.sigmas_m[i], 1e-5);
  }
}

TEST(ObjectQuery, GrowsTheUncertaintyWithTheHorizonAndShrinksTheDistanceByTheMargin) {
  MapView view = testing::ViewOf(DistanceField(kVoxel, kMax), kMax);
  ObjectView& car = testing::AddObject(view, 7, testing::CarShape(kVoxel), Pose::Identity());
  car.position_sigma_m = 0.1;
  car.velocity_sigma_mps = 0.3;
  const Eigen::Vector3d p_W(4.23, 0, 0.5);  // 2 m before the bonnet
  const DistanceBatch now = QueryDistances(view, p_W, {.sigmas = true});
  EXPECT_NEAR(now.distances_m[0], 2.0, 0.01);
  EXPECT_NEAR(now.sigmas_m[0], std::hypot(0.01, 0.1), 1e-5);
  const DistanceBatch later =
      QueryDistances(view, p_W, {.horizon_s = 2, .sigmas = true, .sigma_margin = 1.5});
  EXPECT_NEAR(later.sigmas_m[0], std::hypot(0.01, 0.7), 1e-5);
  EXPECT_NEAR(later.distances_m[0], now.distances_m[0] - 1.5 * later.sigmas_m[0], 1e-5);
  EXPECT_TRUE(later.states[0] & kPredicted);
  EXPECT_FALSE(now.states[0] & kPredicted);
}

TEST(ObjectQuery, LeavesOutRetiredObjectsAndKeepsLostOnes) {
  for (LifeState life : {LifeState::kTracked, LifeState::kCoasting, LifeState::kLost}) {
    MapView view = testing::ViewOf(DistanceField(kVoxel, kMax), kMax);
    testing::AddObject(view, 7, testing::CarShape(kVoxel), Pose::Identity()).life_state = life;
    const DistanceBatch batch = QueryDistances(view, Eigen::Vector3d(0, 0, 0.6), {.objects = true});
    EXPECT_EQ(batch.object_ids[0], 7u);
    EXPECT_EQ(batch.object_indices, std::vector<uint32_t>{0});
    EXPECT_EQ(batch.states[0] & kStateMask, 2);
    EXPECT_EQ((batch.states[0] & kLowConfidence) != 0, life == LifeState::kLost);
    view.objects[0].life_state = LifeState::kRetired;
    view.object_index = nullptr;
    const DistanceBatch retired =
        QueryDistances(view, Eigen::Vector3d(0, 0, 0.6), {.objects = true});
    EXPECT_EQ(retired.object_ids[0], 0u);
    EXPECT_TRUE(retired.object_indices.empty());
    EXPECT_EQ(retired.states[0] & kStateMask, 0);
  }
}

// A wall at x = 0 (solid for x < 0), free space before it, a car 6 m away and another 9 m away.
MapView WallAndCars() {
  const auto wall = [](const Eigen::Vector3d& p) { return p.x(); };
  MapView view = testing::ViewOf(
      testing::ExactField(wall, {Eigen::Vector3d(-1, -2, -0.5), Eigen::Vector3d(10, 2, 1.5)},
                          kVoxel, kMax),
      kMax);
  const auto shape = testing::CarShape(kVoxel);
  Pose T_W_L = Pose::Identity();
  T_W_L.translation() << 6, 0.02, 0.01;
  testing::AddObject(view, 3, shape, T_W_L);
  T_W_L.translation() << 11, 0.02, 0.01;
  testing::AddObject(view, 9, shape, T_W_L).position_sigma_m = 0.04;
  view.object_index = BuildObjectIndex(view.objects);
  return view;
}

TEST(ObjectQuery, OverridesFreeSpaceThatAnObjectCovers) {
  const MapView view = WallAndCars();
  std::mt19937 rng(8);
  int covered = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d p =
        testing::RandomIn({Eigen::Vector3d(3, -1.5, -0.2), Eigen::Vector3d(8.4, 1.5, 1.4)}, rng);
    const Eigen::Vector3d centre = VoxelCentre(VoxelOf(p, kVoxel), kVoxel);
    const double d = testing::CarDistance(centre - Eigen::Vector3d(6, 0.02, 0.01));
    const int state = QueryDistances(view, p).states[0] & kStateMask;
    // By the voxel, whatever the point: its centre inside or its cube cut, within the surface's
    // error.
    const bool below = p.z() < 0.35;  // nothing was seen there
    if (d < 0.2 * kVoxel && !below) {
      EXPECT_EQ(state, 2) << p.transpose();
    }
    if (d > 1.2 * kVoxel && !below) {
      EXPECT_EQ(state, 1) << p.transpose() << " d " << d;
    }
    covered += state == 2;
  }
  EXPECT_GT(covered, 1000);
}

TEST(ObjectQuery, SelectsLayers) {
  const MapView view = WallAndCars();
  const Eigen::Vector3d p(3.0, 0, 0.55);  // 0.77 m before the first car, 3 m from the wall
  const auto ask = [&](const LayerSelection& layers) {
    return QueryDistances(view, p, {.objects = true, .layers = layers});
  };
  EXPECT_NEAR(ask({}).distances_m[0], 0.77, 0.02);
  EXPECT_EQ(ask({}).object_ids[0], 3u);
  EXPECT_NEAR(ask({.static_only = true}).distances_m[0], 3.0, 0.02);
  EXPECT_EQ(ask({.static_only = true}).object_ids[0], 0u);
  EXPECT_NEAR(ask({.without_objects = {ObjectId(3)}}).distances_m[0], 3.0, 0.02);
  EXPECT_NEAR(ask({.only_objects = {ObjectId(3)}}).distances_m[0], 0.77, 0.02);
  const DistanceBatch other = ask({.only_objects = {ObjectId(9)}});
  EXPECT_FLOAT_EQ(other.distances_m[0], 5.f);
  EXPECT_TRUE(other.states[0] & state_byte::kClamped);
  // Static surface does not count there, so its voxel reads as free at low confidence.
  const DistanceBatch wall = QueryDistances(view, Eigen::Vector3d(-0.02, 0, 0.5),
                                            {.layers = {.only_objects = {ObjectId(9)}}});
  EXPECT_EQ(wall.states[0] & (kStateMask | kLowConfidence), 1 | kLowConfidence);
}

TEST(ObjectQuery, WeightedFusionIsThePapersSumAndMinimumIsTheDefault) {
  const MapView view = WallAndCars();
  const Eigen::Vector3d p(3.0, 0, 0.55);
  const double sigma_static = 0.1 * SigmaVoxelsOfCode(CodeOfSigmaVoxels(0.1f));
  const double w_static = 1 - sigma_static / kVoxel, w_object = 1 - 0.01 / kVoxel;
  const double d_static = QueryDistances(view, p, {.layers = {.static_only = true}}).distances_m[0];
  const double d_object =
      QueryDistances(view, p, {.layers = {.only_objects = {ObjectId(3)}}}).distances_m[0];
  const DistanceBatch weighted =
      QueryDistances(view, p, {.objects = true, .sigmas = true, .fusion = Fusion::kWeighted});
  EXPECT_NEAR(weighted.distances_m[0],
              (w_static * d_static + w_object * d_object) / (w_static + w_object), 1e-5);
  EXPECT_EQ(weighted.object_ids[0], 3u);
  EXPECT_NEAR(weighted.sigmas_m[0],
              std::hypot(w_static * sigma_static, w_object * 0.01) / (w_static + w_object), 1e-5);
  EXPECT_NEAR(QueryDistances(view, p).distances_m[0], d_object, 1e-6);
}

}  // namespace
}  // namespace clearance
