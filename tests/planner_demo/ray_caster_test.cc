#include "planner_demo/sim/ray_caster.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "planner_demo/sim/motion.h"
#include "planner_demo/sim/random.h"
#include "planner_demo/sim/sensor.h"

namespace clearance::sim {
namespace {

Eigen::Vector3d Draw(Random& random, double reach) {
  const double x = random.Uniform(-reach, reach);
  const double y = random.Uniform(-reach, reach);
  return {x, y, random.Uniform(-reach, reach)};
}

Eigen::Isometry3d DrawPose(Random& random, double reach) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(random.Uniform(-3.0, 3.0), Draw(random, 1.0).normalized())
                   .toRotationMatrix();
  T.translation() = Draw(random, reach);
  return T;
}

TEST(RayCaster, FindsTheNearestOfAllSolidsWhateverTheHint) {
  Random random(5);
  RayCaster caster;
  std::vector<Solid> all;
  for (int i = 0; i < 60; ++i) {
    const Shape shape = i % 3 == 0   ? Shape(Box{{0.4, 0.7, 0.2}})
                        : i % 3 == 1 ? Shape(Capsule{0.3, 0.5})
                                     : Shape(Cylinder{0.4, 0.6});
    const Eigen::Isometry3d T_W_B = DrawPose(random, 6.0);
    const Solid solid{shape, DrawPose(random, 1.0)};
    caster.Add({solid}, T_W_B, static_cast<uint16_t>(i));
    all.push_back({shape, T_W_B * solid.T_B_S});
  }
  caster.Build();
  int hits = 0;
  for (int i = 0; i < 6000; ++i) {
    const Eigen::Vector3d origin_W = Draw(random, 8.0);
    const Eigen::Vector3d direction_W = Draw(random, 1.0);
    double nearest = std::numeric_limits<double>::infinity();
    int owner = -1;
    for (int s = 0; s < static_cast<int>(all.size()); ++s) {
      const Eigen::Isometry3d T_S_W = all[s].T_B_S.inverse();
      const Interval in = Intersect(all[s].shape, T_S_W * origin_W, T_S_W.linear() * direction_W);
      if (in.enter > in.exit) continue;
      const double t = in.enter > 0.0 ? in.enter : in.exit;
      if (t > 0.0 && t < nearest) {
        nearest = t;
        owner = s;
      }
    }
    for (const int hint : {-1, random.Index(60)}) {
      const RayCaster::Hit hit = caster.Cast(origin_W, direction_W, 1e9, hint);
      if (owner < 0) {
        EXPECT_LT(hit.solid, 0);
        continue;
      }
      ++hits;
      EXPECT_NEAR(hit.t, nearest, 1e-9 * (1.0 + nearest));
      EXPECT_EQ(hit.owner, owner);
    }
  }
  EXPECT_GT(hits, 1000);
}

TEST(RayCaster, ReportsNothingBeyondTheRange) {
  RayCaster caster;
  caster.Add({MakeSphere({0.0, 0.0, 0.0}, 1.0)}, Upright({10.0, 0.0, 0.0}, 0.0), 3);
  caster.Build();
  EXPECT_LT(caster.Cast({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 8.9).solid, 0);
  const RayCaster::Hit hit = caster.Cast({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 9.1);
  EXPECT_DOUBLE_EQ(hit.t, 9.0);
  EXPECT_EQ(hit.owner, 3);
  RayCaster nothing;
  nothing.Build();
  EXPECT_LT(nothing.Cast({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, 1e9).solid, 0);
}

TEST(DepthCamera, SeesAWallAtItsDepthInEveryPixelFarFromTheOrigin) {
  const DepthCamera camera = DepthCamera::WithHorizontalView(64, 48, 1.2, 1e-3, 20.0);
  const Sensor sensor = camera;
  const Eigen::Vector3d far(-1e4, 1e4, 50.0);
  RayCaster caster;
  caster.Add({MakeBox({5.0, -50.0, -50.0}, {6.0, 50.0, 50.0})}, Upright(far, 0.0), 7);
  caster.Build();
  const Eigen::Isometry3d T_W_X = LookAt(far, far + Eigen::Vector3d(1.0, 0.0, 0.0));
  const Scan scan = CastScan(caster, sensor, RayDirections(sensor), T_W_X);
  ASSERT_EQ(scan.ranges_m.size(), 64u * 48u);
  for (size_t i = 0; i < scan.ranges_m.size(); ++i) {
    EXPECT_NEAR(scan.ranges_m[i], 5.0, 1e-8);
    EXPECT_EQ(scan.labels[i], 7);
  }
}

TEST(Lidar, MeasuresRangesOnAGroundPlaneAndNothingAboveTheHorizon) {
  const double angle = std::numbers::pi / 8.0;
  const Sensor sensor = Lidar{16, 90, -angle, angle, 100.0};
  RayCaster caster;
  caster.Add({MakeBox({-500.0, -500.0, -1.0}, {500.0, 500.0, 0.0})}, Upright({0, 0, 0}, 0.3), 0);
  caster.Build();
  const std::vector<Eigen::Vector3d> directions = RayDirections(sensor);
  EXPECT_NEAR(directions[0].z(), std::sin(angle), 1e-12);  // the first beam is the highest
  EXPECT_LT(directions[0].x(), 0.0);                       // and starts behind
  EXPECT_GT(directions[90 / 4].y(), 0.0);                  // turning over the left
  const Scan scan = CastScan(caster, sensor, directions, Upright({3.0, -4.0, 1.5}, 1.0));
  for (size_t i = 0; i < directions.size(); ++i) {
    const double expected = directions[i].z() < 0.0 ? 1.5 / -directions[i].z() : 0.0;
    EXPECT_NEAR(scan.ranges_m[i], expected <= 100.0 ? expected : 0.0, 1e-9);
  }
}

}  // namespace
}  // namespace clearance::sim
