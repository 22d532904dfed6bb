// One object's surfel tree against brute force over its surfels and against closed-form shapes.
#include "server/query/object_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "server/query/point_query.h"
#include "server/query/surfel_tree.h"
#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

constexpr double kVoxel = 0.1;

NearestSurfel BruteForce(const ObjectShape& shape, const Eigen::Vector3f& p_L, float limit_m) {
  NearestSurfel best{-1, limit_m};
  const float radius_m = kSurfelRadiusVoxels * static_cast<float>(shape.voxel_size_m);
  for (size_t i = 0; i < shape.sites.size(); ++i) {
    const float d = DistanceToSurfel(shape.sites[i], radius_m, p_L).distance_m;
    if (d < best.distance_m || (d == best.distance_m && best.site < 0)) {
      best = {static_cast<int>(i), d};
    }
  }
  return best;
}

TEST(ObjectTree, EqualsBruteForceBitForBit) {
  const auto shape = testing::CarShape(kVoxel);
  ASSERT_GT(shape->sites.size(), 1000u);
  std::mt19937 rng(1);
  for (double half : {1.0, 3.0, 20.0}) {
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(half);
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3f p = testing::RandomIn({-reach, reach}, rng).cast<float>();
      for (float limit_m : {0.3f, 4.f, std::numeric_limits<float>::max()}) {
        const NearestSurfel tree = FindNearestSurfel(*shape, p, limit_m);
        const NearestSurfel brute = BruteForce(*shape, p, limit_m);
        ASSERT_EQ(tree.site, brute.site);
        ASSERT_EQ(tree.distance_m, brute.distance_m);
      }
    }
  }
}

TEST(ObjectTree, IsTheSameFromTheSameSitesInAnyOrder) {
  std::mt19937 rng(4);
  std::uniform_int_distribution<int> cell(-9, 9);
  std::vector<SurfaceSite> sites(700);
  for (SurfaceSite& site : sites) {  // on a grid: many ties
    site.p_L = 0.1f * Eigen::Vector3f(cell(rng), cell(rng), cell(rng));
    site.normal_L = Eigen::Vector3f(cell(rng), cell(rng), 10).normalized();
    site.sigma_m = 0.01f;
  }
  const auto shape = BuildObjectShape(sites, kVoxel);
  for (int round = 0; round < 10; ++round) {
    std::vector<SurfaceSite> again = shape->sites;
    if (round > 0) std::shuffle(again.begin(), again.end(), rng);
    const auto other = BuildObjectShape(again, kVoxel);
    ASSERT_EQ(other->tree->leaves.size(), shape->tree->leaves.size());
    for (size_t i = 0; i < shape->tree->leaves.size(); ++i) {
      const SurfelTree::Leaf &a = shape->tree->leaves[i], &b = other->tree->leaves[i];
      EXPECT_EQ(std::memcmp(a.p, b.p, sizeof(a.p)), 0);
      EXPECT_EQ(std::memcmp(a.normal, b.normal, sizeof(a.normal)), 0);
      EXPECT_EQ(a.first, b.first);
      EXPECT_EQ(a.count, b.count);
    }
    ASSERT_EQ(other->tree->nodes.size(), shape->tree->nodes.size());
    EXPECT_EQ(std::memcmp(other->tree->nodes.data(), shape->tree->nodes.data(),
                          shape->tree->nodes.size() * sizeof(SurfelTree::Node)),
              0);
  }
}

TEST(ObjectTree, BoundsHoldEveryDisc) {
  const auto shape = testing::CarShape(kVoxel);
  std::mt19937 rng(2);
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(8);
  for (int i = 0; i < 5000; ++i) {
    const Eigen::Vector3f p = testing::RandomIn({-reach, reach}, rng).cast<float>();
    const float bound = shape->bounds_L.exteriorDistance(p);
    EXPECT_LE(bound, FindNearestSurfel(*shape, p, 100.f).distance_m + 1e-5f);
  }
}

TEST(ObjectTree, WithoutUsableSitesHasNoSurface) {
  EXPECT_EQ(FindNearestSurfel(*BuildObjectShape({}, kVoxel), Eigen::Vector3f::Zero(), 5.f).site,
            -1);
  SurfaceSite bad{Eigen::Vector3f(0, std::nanf(""), 0), Eigen::Vector3f::UnitX(), 0.f};
  EXPECT_TRUE(BuildObjectShape({bad}, kVoxel)->sites.empty());
}

struct ShapeCase {
  const char* name;
  testing::SignedDistance distance;
  bool exact_inside;
  double mean_voxels, p99_voxels;
};

double SphereDistance(const Eigen::Vector3d& p) { return p.norm() - 0.8; }
double BoxDistance(const Eigen::Vector3d& p) {
  const Eigen::Vector3d q = p.cwiseAbs() - Eigen::Vector3d(0.9, 0.5, 0.6);
  return q.cwiseMax(0).norm() + std::min(0.0, q.maxCoeff());
}

TEST(ObjectShape, SignedDistanceMeetsTheTruthInsideAndOut) {
  const ShapeCase cases[] = {{"sphere", SphereDistance, true, 0.06, 0.12},
                             {"box", BoxDistance, true, 0.12, 0.55},
                             {"car", testing::CarDistance, false, 0.12, 0.55}};
  for (const ShapeCase& c : cases) {
    const Eigen::AlignedBox3d box(Eigen::Vector3d(-3, -2, -1), Eigen::Vector3d(3, 2, 2));
    const auto shape = BuildObjectShape(testing::SampleSites(c.distance, box, kVoxel), kVoxel);
    MapView view = testing::ViewOf(DistanceField(kVoxel, 5.0), 5.0);
    const Pose T_W_L = testing::RandomPose(3, 10'000);
    testing::AddObject(view, 1, shape, T_W_L);
    view.object_index = BuildObjectIndex(view.objects);
    std::mt19937 rng(4);
    std::vector<double> errors;
    int wrong = 0, inside = 0;
    double angle = 0;
    for (int i = 0; i < 20000; ++i) {
      const Eigen::Vector3d p_L = testing::RandomIn(box, rng);
      const double truth = c.distance(p_L);
      const Eigen::Vector3d p_W = T_W_L * p_L;
      const DistanceBatch batch = QueryDistances(view, p_W, {.gradients = true});
      const double d = batch.distances_m[0];
      // Inside a union of boxes the closed form is only a bound of the depth.
      if (truth > 0 || c.exact_inside) errors.push_back((d - truth) / kVoxel);
      if (std::abs(truth) > 0.5 * kVoxel) wrong += (d < 0) != (truth < 0);
      inside += truth < 0;
      const Eigen::Vector3d gradient_L =
          T_W_L.linear().transpose() * batch.gradients_W.col(0).cast<double>();
      EXPECT_NEAR(gradient_L.norm(), 1, 1e-4);
      if (truth < 0 && !c.exact_inside) continue;
      angle += std::acos(std::clamp(gradient_L.dot(testing::NumericalGradient(c.distance, p_L)),
                                    -1.0, 1.0)) /
               20000 * 180 / M_PI;
    }
    const testing::ErrorSummary e = testing::Summarize(errors);
    std::printf("%-6s %zu sites: mean %.3f p99 %.3f max %.3f voxel, gradient %.1f deg, %d inside\n",
                c.name, shape->sites.size(), e.mean, e.p99, e.max, angle, inside);
    EXPECT_GT(inside, 500) << c.name;
    EXPECT_LE(e.mean, c.mean_voxels) << c.name;
    EXPECT_LE(e.p99, c.p99_voxels) << c.name;
    EXPECT_LE(angle, 5.0) << c.name;
    EXPECT_LE(wrong, 20) << c.name;
  }
}

TEST(ObjectShape, IsNotFreeBehindTheOneSideThatWasSeen) {
  // A car seen from the left, from the front and from above only.
  const Eigen::AlignedBox3d box(Eigen::Vector3d(-3, -2, -1), Eigen::Vector3d(3, 2, 2));
  std::vector<SurfaceSite> sites = testing::SampleSites(testing::CarDistance, box, kVoxel);
  std::erase_if(sites, [](const SurfaceSite& site) {
    return site.normal_L.x() < 0.5f && site.normal_L.y() < 0.5f && site.normal_L.z() < 0.5f;
  });
  const auto shape = BuildObjectShape(sites, kVoxel);
  int inside = 0, total = 0;
  std::mt19937 rng(5);
  for (int i = 0; i < 4000; ++i) {
    const Eigen::Vector3d p = testing::RandomIn(box, rng);
    if (testing::CarDistance(p) > -0.5 * kVoxel) continue;
    ++total;
    const Eigen::Vector3f p_L = p.cast<float>();
    inside += IsInside(*shape, p_L, FindNearestSurfel(*shape, p_L, 10.f).distance_m);
  }
  ASSERT_GT(total, 200);
  // The rest lies above the ledge before the cabin's unseen wall: nothing tells it from outside.
  EXPECT_GE(inside, 0.95 * total);
}

TEST(ObjectShape, OutvotesAStrayNormal) {
  std::vector<SurfaceSite> sites = testing::SampleSites(
      SphereDistance, {Eigen::Vector3d(-1, -1, -1), Eigen::Vector3d(1, 1, 1)}, kVoxel);
  std::mt19937 rng(6);
  for (SurfaceSite& site : sites) {
    if (rng() % 20 == 0) site.normal_L = -site.normal_L;
  }
  const auto shape = BuildObjectShape(sites, kVoxel);
  int wrong = 0;
  for (int i = 0; i < 4000; ++i) {
    const Eigen::Vector3d p =
        testing::RandomIn({Eigen::Vector3d(-1, -1, -1), Eigen::Vector3d(1, 1, 1)}, rng);
    if (std::abs(SphereDistance(p)) < kVoxel) continue;
    const Eigen::Vector3f p_L = p.cast<float>();
    const float nearest_m = FindNearestSurfel(*shape, p_L, 10.f).distance_m;
    wrong += IsInside(*shape, p_L, nearest_m) != (SphereDistance(p) < 0);
  }
  EXPECT_LE(wrong, 4);
}

}  // namespace
}  // namespace clearance
