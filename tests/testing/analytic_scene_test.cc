#include "tests/testing/analytic_scene.h"

#include <gtest/gtest.h>

namespace clearance::testing {
namespace {

TEST(AnalyticScene, RaysEndOnTheSurface) {
  for (const ViewedScene& standard : StandardScenes()) {
    const ViewedScene v = standard.Moved(RandomPose(7, 100.0));
    int hits = 0;
    for (const Pose& T_W_X : v.views) {
      const Intrinsics k;
      const DepthImage image = v.scene.RenderDepth(T_W_X, k);
      for (size_t i = 0; i < image.depth.size(); i += 97) {
        if (image.depth[i] == 0) continue;
        const double z = image.depth[i] * k.depth_scale_m;
        const Eigen::Vector3d p_X((i % k.width - k.cx) / k.fx * z, (i / k.width - k.cy) / k.fy * z,
                                  z);
        EXPECT_NEAR(v.scene.Distance(T_W_X * p_X), 0, k.depth_scale_m) << v.scene.name();
        ++hits;
      }
    }
    EXPECT_GT(hits, 1000) << v.scene.name();
  }
}

TEST(AnalyticScene, GradientsAreThoseOfTheDistance) {
  for (const ViewedScene& standard : StandardScenes()) {
    const AnalyticScene scene = standard.Moved(RandomPose(3, 10.0)).scene;
    for (uint32_t i = 0; i < 200; ++i) {
      const Eigen::Vector3d p =
          scene.solids().back().T_W_P * (RandomPose(100 + i, 2.0).translation());
      Eigen::Vector3d difference;
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d e = 1e-6 * Eigen::Vector3d::Unit(k);
        difference[k] = (scene.Distance(p + e) - scene.Distance(p - e)) / 2e-6;
      }
      if (std::abs(difference.norm() - 1) > 1e-6) continue;  // on a ridge
      EXPECT_NEAR((difference - scene.Gradient(p)).norm(), 0, 1e-5) << scene.name() << " " << i;
      if (scene.Distance(p) > 0) {
        EXPECT_NEAR(scene.Distance(scene.NearestSurface(p)), 0, 1e-9);
      }
    }
  }
}

TEST(AnalyticScene, LidarPointsLieOnTheSurface) {
  const ViewedScene v = BoxScene();
  const Pose T_W_X = LidarFromCamera(v.views[0]);
  const PointCloud cloud = v.scene.RenderLidar(T_W_X, {});
  int hits = 0;
  for (Eigen::Index i = 0; i < cloud.points_X.cols(); ++i) {
    if (cloud.points_X.col(i).isZero()) continue;
    EXPECT_NEAR(v.scene.Distance(T_W_X * cloud.points_X.col(i).cast<double>()), 0, 1e-5);
    ++hits;
  }
  EXPECT_GT(hits, 5000);
}

}  // namespace
}  // namespace clearance::testing
