#include "planner_demo/plan/dubins.h"

#include <gtest/gtest.h>

#include <cmath>

#include "planner_demo/sim/random.h"

namespace clearance::demo {
namespace {

TEST(DubinsCurve, EndsAtItsTargetAndTurnsNoTighterThanItMay) {
  sim::Random random(1);
  for (int i = 0; i < 20000; ++i) {
    const double radius_m = random.Uniform(0.5, 5.0);
    const double around_m = i % 2 == 0 ? 3.0 : 30.0;  // near targets need three arcs
    const PlanarPose from{random.Uniform(-around_m, around_m), random.Uniform(-around_m, around_m),
                          random.Uniform(-4.0, 4.0)};
    const PlanarPose to{random.Uniform(-around_m, around_m), random.Uniform(-around_m, around_m),
                        random.Uniform(-4.0, 4.0)};
    const DubinsCurve curve(from, to, radius_m);
    ASSERT_TRUE(std::isfinite(curve.length_m()));
    EXPECT_GE(curve.length_m() + 1e-9, std::hypot(to.x_m - from.x_m, to.y_m - from.y_m));
    const PlanarPose end = curve.At(curve.length_m());
    EXPECT_NEAR(end.x_m, to.x_m, 1e-4);
    EXPECT_NEAR(end.y_m, to.y_m, 1e-4);
    EXPECT_NEAR(std::remainder(end.heading_rad - to.heading_rad, 2 * M_PI), 0.0, 1e-4);
    PlanarPose last = from;
    const double step_m = curve.length_m() / 50;
    for (int k = 1; k <= 50; ++k) {
      const PlanarPose at = curve.At(k * step_m);
      EXPECT_LE(std::hypot(at.x_m - last.x_m, at.y_m - last.y_m), step_m + 1e-9);
      EXPECT_LE(std::abs(at.heading_rad - last.heading_rad), step_m / radius_m + 1e-9);
      last = at;
    }
  }
}

TEST(DubinsCurve, KnownLengths) {
  // Straight ahead; a half circle; a quarter circle either way.
  EXPECT_NEAR(DubinsCurve({0, 0, 0}, {5, 0, 0}, 1.0).length_m(), 5.0, 1e-9);
  EXPECT_NEAR(DubinsCurve({0, 0, 0}, {0, 2, M_PI}, 1.0).length_m(), M_PI, 1e-9);
  EXPECT_NEAR(DubinsCurve({0, 0, 0}, {2, 2, M_PI / 2}, 2.0).length_m(), M_PI, 1e-9);
  EXPECT_NEAR(DubinsCurve({0, 0, 0}, {2, -2, -M_PI / 2}, 2.0).length_m(), M_PI, 1e-9);
  // Backwards on the spot: a full circle with a bulge, 7 pi / 3 - shortest with three arcs.
  EXPECT_NEAR(DubinsCurve({0, 0, 0}, {0, 0, M_PI}, 1.0).length_m(), 7.0 * M_PI / 3.0, 1e-6);
  EXPECT_EQ(DubinsCurve({1, 2, 3}, {1, 2, 3}, 1.0).length_m(), 0.0);
}

TEST(DubinsCurve, APartOfACurveIsTheCurveOfThatPart) {
  sim::Random random(2);
  for (int i = 0; i < 3000; ++i) {
    const PlanarPose from{0, 0, random.Uniform(-3, 3)};
    const PlanarPose to{random.Uniform(-9, 9), random.Uniform(-9, 9), random.Uniform(-3, 3)};
    const DubinsCurve curve(from, to, 1.0);
    double a = random.Uniform(0, curve.length_m()), b = random.Uniform(0, curve.length_m());
    if (a > b) std::swap(a, b);
    const DubinsCurve part(curve.At(a), curve.At(b), 1.0);
    EXPECT_NEAR(part.length_m(), b - a, 1e-5);
  }
}

}  // namespace
}  // namespace clearance::demo
