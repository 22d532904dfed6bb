#include "server/esdf/site_extraction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/esdf/exact_world.h"

namespace clearance {
namespace {

using testing::AnalyticScene;
using testing::ExactWorld;
using testing::RandomPose;
using testing::Solid;

constexpr double kH = 0.1;

// Exact world with one solid, shown in a cube of +-extent about its centre.
ExactWorld Shown(const Solid& solid, double extent_m) {
  ExactWorld world(kH);
  world.solids().push_back(solid);
  const Eigen::Vector3d c = solid.T_W_P.translation(), e = Eigen::Vector3d::Constant(extent_m);
  world.Show({Aabb(c - e, c + e)});
  return world;
}

Solid Plane(uint32_t seed, double offset_m) {
  Solid s;
  s.kind = Solid::Kind::kHalfSpace;
  s.T_W_P = RandomPose(seed, offset_m);
  return s;
}

Solid Pole(uint32_t seed, double diameter_m) {
  Solid s;
  s.kind = Solid::Kind::kCylinder;
  s.T_W_P = RandomPose(seed, 3.0);
  s.size = {diameter_m / 2, 0, 4.0};
  return s;
}

// Halo copies of a function of the position in voxels, weight 1 where `has_weight`.
template <typename Mean, typename HasWeight>
BlockSites SitesOf(const Mean& mean_voxels, const HasWeight& has_weight) {
  float mean[kHaloVoxels] = {}, weight[kHaloVoxels] = {};
  for (int x = -1; x <= 8; ++x) {
    for (int y = -1; y <= 8; ++y) {
      for (int z = -1; z <= 8; ++z) {
        if (!has_weight(x, y, z)) continue;
        mean[HaloOffset(x, y, z)] = static_cast<float>(mean_voxels(x, y, z) * kH);
        weight[HaloOffset(x, y, z)] = 1;
      }
    }
  }
  BlockSites sites;
  ExtractSites(mean, weight, kH, 0.3f, &sites);
  return sites;
}

double NearestSite(const std::vector<SurfaceSite>& sites, const Eigen::Vector3d& p) {
  double best = 1e9;
  for (const SurfaceSite& s : sites) best = std::min(best, (s.p_L.cast<double>() - p).norm());
  return best;
}

TEST(SiteExtraction, PutsSitesOnPlanesInAnyDirection) {
  for (uint32_t seed = 1; seed <= 30; ++seed) {
    const Solid plane = Plane(seed, 3.0);
    const std::vector<SurfaceSite> sites =
        ExtractSurfaceSites(Shown(plane, 0.8).map(), FusionOptions());
    ASSERT_GT(sites.size(), 100u);
    const Eigen::Vector3d normal = plane.T_W_P.linear().col(2);
    for (const SurfaceSite& s : sites) {
      // A foot a hair outside its cube is pulled in; positions are stored in steps of 1/256 voxel.
      EXPECT_NEAR(plane.Distance(s.p_L.cast<double>()), 0, 0.035 * kH);
      EXPECT_GT(s.normal_L.cast<double>().dot(normal), std::cos(0.22));
    }
  }
}

TEST(SiteExtraction, LeavesNoGapsOnPlanes) {
  for (uint32_t seed = 1; seed <= 10; ++seed) {
    const Solid plane = Plane(seed, 1.0);
    const std::vector<SurfaceSite> sites =
        ExtractSurfaceSites(Shown(plane, 0.8).map(), FusionOptions());
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(-0.5, 0.5);
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d on_plane = plane.T_W_P * Eigen::Vector3d(u(rng), u(rng), 0);
      EXPECT_LT(NearestSite(sites, on_plane), 0.95 * kH);
    }
  }
}

TEST(SiteExtraction, LeavesNoGapsWhereANoisyPlaneRunsAlongABorderOfCubes) {
  std::mt19937 rng(9);
  std::normal_distribution<double> noise(0, 0.05);
  for (int repeat = 0; repeat < 50; ++repeat) {
    // Two layers of voxels see a wall exactly between them, x = 3 | 4.
    const BlockSites sites = SitesOf([&](int x, int, int) { return x - 3.5 + noise(rng); },
                                     [](int x, int, int) { return x >= 1 && x <= 6; });
    for (int y = 1; y < 7; ++y) {
      for (int z = 1; z < 7; ++z) {
        bool near = false;
        for (int k = 0; k < 9; ++k) {
          const int column = (y + k / 3 - 1) << 3 | (z + k % 3 - 1);
          near |= clearance::Test(sites.mask, 3 << 6 | column) ||
                  clearance::Test(sites.mask, 4 << 6 | column);
        }
        EXPECT_TRUE(near) << y << " " << z;
      }
    }
  }
}

TEST(SiteExtraction, FollowsSpheresWithinATwelfthOfAVoxel) {
  for (uint32_t seed = 1; seed <= 10; ++seed) {
    Solid sphere;
    sphere.kind = Solid::Kind::kSphere;
    sphere.T_W_P = RandomPose(seed, 2.0);
    sphere.size.setConstant(0.6);
    for (const SurfaceSite& s : ExtractSurfaceSites(Shown(sphere, 1.0).map(), FusionOptions())) {
      EXPECT_NEAR(sphere.Distance(s.p_L.cast<double>()), 0, 0.08 * kH);
    }
  }
}

TEST(SiteExtraction, KeepsBoxEdgesWithinAThirdOfAVoxelAndWithoutGaps) {
  for (uint32_t seed = 1; seed <= 10; ++seed) {
    Solid box;
    box.T_W_P = RandomPose(seed, 2.0);
    box.size = {1.0, 0.8, 0.6};
    const std::vector<SurfaceSite> sites =
        ExtractSurfaceSites(Shown(box, 1.0).map(), FusionOptions());
    for (const SurfaceSite& s : sites) {
      EXPECT_NEAR(box.Distance(s.p_L.cast<double>()), 0, 0.33 * kH);
    }
    for (double t = -0.5; t <= 0.5; t += 0.01) {
      const Eigen::Vector3d on_edge = box.T_W_P * Eigen::Vector3d(t, 0.4, 0.3);
      EXPECT_LT(NearestSite(sites, on_edge), 1.0 * kH) << seed << " " << t;
    }
  }
}

TEST(SiteExtraction, SeesAPoleThinnerThanAVoxelAllAlong) {
  for (uint32_t seed = 1; seed <= 20; ++seed) {
    const Solid pole = Pole(seed, 0.08);
    const std::vector<SurfaceSite> sites =
        ExtractSurfaceSites(Shown(pole, 1.0).map(), FusionOptions());
    for (double z = -0.7; z <= 0.7; z += 0.01) {
      EXPECT_LT(NearestSite(sites, pole.T_W_P * Eigen::Vector3d(0.04, 0, z)), 1.3 * kH) << seed;
    }
    for (const SurfaceSite& s : sites) {
      EXPECT_NEAR(pole.Distance(s.p_L.cast<double>()), 0, 0.35 * kH);
    }
  }
}

TEST(SiteExtraction, HoldsEverySiteInItsOwnCube) {
  for (uint32_t seed = 1; seed <= 5; ++seed) {
    const ExactWorld world = Shown(Pole(seed, 0.5), 1.0);
    for (const BlockIndex& b : world.map().BandBlocks()) {
      float mean[kHaloVoxels], weight[kHaloVoxels];
      world.map().ReadBand(b, mean, weight);
      BlockSites sites;
      ExtractSites(mean, weight, kH, 0.3f, &sites);
      ForEachSet(sites.mask, [&](int o) {
        const FieldVoxel& s = sites.site[o];
        for (int d : {s.dx, s.dy, s.dz}) {
          EXPECT_GE(d, -128);
          EXPECT_LE(d, 127);
        }
      });
    }
  }
}

int Count(const BlockSites& sites) {
  int count = 0;
  ForEachSet(sites.mask, [&](int) { ++count; });
  return count;
}

TEST(SiteExtraction, FindsNothingBetweenAFreeVoxelAndAnUnseenOne) {
  const BlockSites sites =
      SitesOf([](int, int, int) { return 1.2; }, [](int x, int, int) { return x < 4; });
  EXPECT_EQ(Count(sites), 0);
}

TEST(SiteExtraction, TakesAJumpFromFrontToBehindForNoCrossing) {
  // Seen past an edge at +1.2 voxels, next to what lies 1.2 voxels behind another surface.
  const BlockSites sites = SitesOf([](int x, int, int) { return x < 4 ? 1.2 : -1.2; },
                                   [](int, int, int) { return true; });
  EXPECT_EQ(Count(sites), 0);
}

TEST(SiteExtraction, WorksWhereANeighbourIsMissing) {
  // A floor at z = 3.6 of which only a column of one voxel's width was seen.
  const BlockSites sites = SitesOf([](int, int, int z) { return z - 3.1; },
                                   [](int x, int y, int) { return x == 4 && y == 4; });
  ASSERT_EQ(Count(sites), 1);
  const int o = 4 << 6 | 4 << 3 | 3;
  ASSERT_TRUE(clearance::Test(sites.mask, o));
  EXPECT_NEAR(sites.site[o].dz, 26, 1);
  EXPECT_NEAR(NormalOfCode(sites.site[o].normal_code()).z(), 1, 1e-5);
}

TEST(SiteExtraction, HoldsLightVoxelsForNoSurface) {
  float mean[kHaloVoxels] = {}, weight[kHaloVoxels];
  std::fill(weight, weight + kHaloVoxels, 0.29f);
  BlockSites sites;
  ExtractSites(mean, weight, kH, 0.3f, &sites);
  EXPECT_EQ(Count(sites), 0);
}

TEST(SiteExtraction, IsSurerOfHeavierSurface) {
  float mean[kHaloVoxels], light[kHaloVoxels], heavy[kHaloVoxels];
  for (int x = -1; x <= 8; ++x) {
    for (int i = 0; i < kHaloSide * kHaloSide; ++i) {
      const int h = (x + 1) * kHaloSide * kHaloSide + i;
      mean[h] = static_cast<float>((x - 3.2) * kH);
      light[h] = 0.5f;
      heavy[h] = 20.f;
    }
  }
  BlockSites few, many;
  ExtractSites(mean, light, kH, 0.3f, &few);
  ExtractSites(mean, heavy, kH, 0.3f, &many);
  const int o = 3 << 6 | 4 << 3 | 4;
  ASSERT_TRUE(clearance::Test(few.mask, o) && clearance::Test(many.mask, o));
  EXPECT_NEAR(SigmaVoxelsOfCode(few.site[o].sigma_code()), 0.43, 0.04);
  EXPECT_NEAR(SigmaVoxelsOfCode(many.site[o].sigma_code()), 0.084, 0.01);
}

}  // namespace
}  // namespace clearance
