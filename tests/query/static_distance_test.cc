// The static look-up against closed-form distances and against its own sites.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "server/query/point_query.h"
#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

using testing::ErrorSummary;
using testing::SignedDistance;

constexpr double kVoxel = 0.1;
constexpr double kMax = 5.0;

struct Case {
  std::string name;
  SignedDistance distance;         // about the origin
  double mean_voxels, p99_voxels;  // what the look-up may err, sites as good as they can be
};

std::vector<Case> Cases() {
  const auto box = [](const Eigen::Vector3d& p) {
    const Eigen::Vector3d q = p.cwiseAbs() - Eigen::Vector3d(0.8, 0.5, 0.6);
    return q.cwiseMax(0).norm() + std::min(0.0, q.maxCoeff());
  };
  return {
      {"Plane", [](const Eigen::Vector3d& p) { return p.z(); }, 0.03, 0.1},
      {"Sphere", [](const Eigen::Vector3d& p) { return p.norm() - 1.0; }, 0.03, 0.1},
      // Sites that are foot points leave the edges of a convex box bare: most of the error is
      // theirs.
      {"Box", box, 0.12, 0.5},
      {"Corner", [](const Eigen::Vector3d& p) { return p.minCoeff(); }, 0.03, 0.2},
      {"Pole", [](const Eigen::Vector3d& p) { return p.head<2>().norm() - 0.04; }, 0.08, 0.3},
  };
}

// The case in a pose, with the cube of +-`half` about it in W.
struct Posed {
  Pose T_W_S;
  SignedDistance distance_W;
  Eigen::AlignedBox3d box_W;
};

Posed InPose(const Case& c, const Pose& T_W_S, double half) {
  const Pose T_S_W = T_W_S.inverse();
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(half);
  return {T_W_S,
          [c, T_S_W](const Eigen::Vector3d& p) { return c.distance(T_S_W * p); },
          {T_W_S.translation() - reach, T_W_S.translation() + reach}};
}

class StaticDistance : public ::testing::TestWithParam<int> {};

TEST_P(StaticDistance, MeetsTheTruthOnAndOffTheGridInRandomPoses) {
  const Case c = Cases()[GetParam()];
  for (uint32_t seed = 0; seed < 3; ++seed) {
    Pose T_W_S = testing::RandomPose(seed, 1.0);
    if (seed == 1) T_W_S.translation() += Eigen::Vector3d(-10000.03, 10000.07, -50);
    const Posed posed = InPose(c, T_W_S, 2.3);
    const MapView view =
        testing::ViewOf(testing::ExactField(posed.distance_W, posed.box_W, kVoxel, kMax), kMax);
    std::mt19937 rng(seed);
    std::vector<Eigen::Vector3d> points;
    while (points.size() < 20000) {
      Eigen::Vector3d p = testing::RandomIn(posed.box_W, rng);
      if (points.size() % 2) p = VoxelCentre(VoxelOf(p, kVoxel), kVoxel);
      const double d = posed.distance_W(p);
      if (d < 0 || d > kMax - 2 * kVoxel) continue;
      // Only where the nearest surface is part of the field.
      const Eigen::Vector3d foot = p - d * testing::NumericalGradient(posed.distance_W, p);
      const Eigen::Vector3d margin = Eigen::Vector3d::Constant(0.3);
      if ((foot.array() < (posed.box_W.min() + margin).array()).any()) continue;
      if ((foot.array() > (posed.box_W.max() - margin).array()).any()) continue;
      points.push_back(p);
    }
    Eigen::Matrix3Xd matrix(3, points.size());
    for (size_t i = 0; i < points.size(); ++i) matrix.col(i) = points[i];
    const DistanceBatch batch = QueryDistances(view, matrix, {.gradients = true});
    std::vector<double> errors, angles;
    int wrong = 0;
    for (size_t i = 0; i < points.size(); ++i) {
      const double truth = posed.distance_W(points[i]);
      errors.push_back((batch.distances_m[i] - truth) / kVoxel);
      if (truth > 0.25 * kVoxel) {
        wrong += batch.distances_m[i] < 0;
        const Eigen::Vector3d g = batch.gradients_W.col(i).cast<double>();
        EXPECT_NEAR(g.norm(), 1.0, 1e-4);
        angles.push_back(std::acos(
            std::clamp(g.dot(testing::NumericalGradient(posed.distance_W, points[i])), -1.0, 1.0)));
      }
    }
    const ErrorSummary e = testing::Summarize(errors), a = testing::Summarize(angles);
    std::printf("%-7s pose %u: mean %.3f p99 %.3f max %.3f voxel, gradient mean %.1f deg\n",
                c.name.c_str(), seed, e.mean, e.p99, e.max, a.mean * 180 / M_PI);
    EXPECT_LE(e.mean, c.mean_voxels) << c.name << " seed " << seed;
    EXPECT_LE(e.p99, c.p99_voxels) << c.name << " seed " << seed;
    EXPECT_LE(a.mean, 0.12) << c.name << " seed " << seed;
    EXPECT_EQ(wrong, 0) << c.name << " seed " << seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Shapes, StaticDistance, ::testing::Range(0, 5),
                         [](const auto& info) { return Cases()[info.param].name; });

TEST(StaticLookup, NeverAnswersLessThanTheDistanceToTheSitesFarFromSurfaces) {
  const Case sphere = Cases()[1];
  const Posed posed = InPose(sphere, testing::RandomPose(7, 2), 2.8);
  const MapView view =
      testing::ViewOf(testing::ExactField(posed.distance_W, posed.box_W, kVoxel, kMax), kMax);
  const std::vector<Eigen::Vector3d> sites =
      testing::SamplePositions(posed.distance_W, posed.box_W, kVoxel);
  std::mt19937 rng(1);
  std::vector<double> errors;
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3d p = testing::RandomIn(posed.box_W, rng);
    double truth = kMax;
    for (const Eigen::Vector3d& site : sites) truth = std::min(truth, (p - site).norm());
    if (truth < 2.6 * kVoxel) continue;
    const double d = std::abs(QueryDistances(view, p).distances_m[0]);
    EXPECT_GE(d, truth - 0.01 * kVoxel);
    errors.push_back((d - truth) / kVoxel);
  }
  ASSERT_GT(errors.size(), 1000u);
  EXPECT_LE(testing::Summarize(errors).max, 0.38);
}

TEST(StaticLookup, IsContinuousAlongStraightLines) {
  for (const Case& c : Cases()) {
    const Posed posed = InPose(c, testing::RandomPose(11, 1), 2.0);
    const MapView view =
        testing::ViewOf(testing::ExactField(posed.distance_W, posed.box_W, kVoxel, kMax), kMax);
    std::mt19937 rng(3);
    double largest = 0;
    for (int line = 0; line < 50; ++line) {
      const Eigen::Vector3d a = testing::RandomIn(posed.box_W, rng);
      const Eigen::Vector3d b = testing::RandomIn(posed.box_W, rng);
      const int steps = static_cast<int>((b - a).norm() / (0.01 * kVoxel));
      Eigen::Matrix3Xd points(3, steps);
      for (int i = 0; i < steps; ++i) points.col(i) = a + (b - a) * i / steps;
      const DistanceBatch batch = QueryDistances(view, points);
      for (int i = 1; i < steps; ++i) {
        largest = std::max<double>(
            largest, std::abs(batch.distances_m[i] - batch.distances_m[i - 1]) / kVoxel);
      }
    }
    // A true distance changes by 0.01; the eight sites of two neighbouring cells may differ.
    EXPECT_LE(largest, 0.3) << c.name;
  }
}

}  // namespace
}  // namespace clearance
