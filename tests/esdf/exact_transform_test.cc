#include "server/esdf/exact_transform.h"

#include <gtest/gtest.h>

#include <random>

namespace clearance {
namespace {

TEST(ExactTransform, EqualsBruteForce) {
  for (double offset : {0.0, -3.3, 1e4}) {
    std::mt19937 rng(1);
    std::uniform_real_distribution<double> u(-4, 4);
    const Eigen::Vector3d centre(offset, -offset, offset);
    for (int count : {1, 7, 500}) {
      std::vector<Eigen::Vector3d> sites;
      for (int i = 0; i < count; ++i) {
        sites.push_back(centre + Eigen::Vector3d(u(rng), u(rng), u(rng)));
      }
      const ExactTransform exact(sites, 0.1, 3.0);
      for (int i = 0; i < 300; ++i) {
        const Eigen::Vector3d p = centre + 1.5 * Eigen::Vector3d(u(rng), u(rng), u(rng));
        int32_t best = -1;
        for (int32_t k = 0; k < count; ++k) {
          const double d = (sites[static_cast<size_t>(k)] - p).norm();
          if (d > 3.0) continue;
          if (best < 0 || d < (sites[static_cast<size_t>(best)] - p).norm()) best = k;
        }
        const ExactTransform::Nearest found = exact.Find(p);
        ASSERT_EQ(found.site, best);
        if (best >= 0) {
          EXPECT_NEAR(found.distance_m, (sites[static_cast<size_t>(best)] - p).norm(), 1e-12);
        }
      }
    }
  }
}

TEST(ExactTransform, FindsNothingWithoutSites) {
  const ExactTransform exact({}, 0.1, 5.0);
  EXPECT_EQ(exact.Find({1, 2, 3}).site, -1);
}

}  // namespace
}  // namespace clearance
