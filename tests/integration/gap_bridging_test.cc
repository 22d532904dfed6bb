#include "server/integration/gap_bridging.h"

#include <gtest/gtest.h>

#include "tests/testing/analytic_scene.h"

namespace clearance {
namespace {

using Eigen::Vector3d;
using testing::AnalyticScene;
using testing::Solid;

constexpr double kVoxel = 0.1;

Pose At(double x, double y, double z) { return Pose(Eigen::Translation3d(x, y, z)); }

Solid Ground() {
  Solid s;
  s.kind = Solid::Kind::kHalfSpace;
  return s;
}

Solid Box(const Vector3d& centre, const Vector3d& size, uint16_t label = 0) {
  Solid s;
  s.kind = Solid::Kind::kBox;
  s.T_W_P = At(centre.x(), centre.y(), centre.z());
  s.size = size;
  s.label = label;
  return s;
}

TEST(GapBridging, GroundBetweenTheRingsOfALidarIsFilledOnTheGround) {
  const AnalyticScene scene("ground", {Ground()});
  const Pose T_W_X = At(0, 0, 1.7);
  const PointCloud cloud = scene.RenderLidar(T_W_X, {});
  const RangeImage image = RangeImage::FromCloud(cloud, 0.001, 40.0);
  const Eigen::Matrix3Xf bridges = BridgeGaps(image, kStaticWorld, 0.2);
  ASSERT_GT(bridges.cols(), 5000);
  for (Eigen::Index i = 0; i < bridges.cols(); ++i) {
    EXPECT_NEAR((T_W_X * bridges.col(i).cast<double>()).z(), 0, 0.03);
  }
}

TEST(GapBridging, DepthEdgesAreNotBridged) {
  // A wall 1.5 m behind the edge of another; nothing lies in the gap.
  const AnalyticScene scene("edge",
                            {Box({4.0, 0, 0}, {0.2, 2.0, 6.0}), Box({4.4, 0, 0}, {0.2, 20, 20})});
  const Pose T_W_X = testing::LookAt({0, 0.3, 0.2}, {4, 0.5, 0});
  const RangeImage image = RangeImage::FromDepth(scene.RenderDepth(T_W_X, {}), 20.0);
  const Eigen::Matrix3Xf bridges = BridgeGaps(image, kStaticWorld, kVoxel);
  for (Eigen::Index i = 0; i < bridges.cols(); ++i) {
    EXPECT_NEAR(scene.Distance(T_W_X * bridges.col(i).cast<double>()), 0, 0.3 * kVoxel);
  }
}

TEST(GapBridging, RoofSeenByOneRowOfPixelsIsBridgedForAnObject) {
  const AnalyticScene scene("roof", {Ground(), Box({6.0, 0, 0.7}, {3.0, 1.6, 1.4}, 5)});
  // So low over the roof that two rows of pixels a frame fall on it.
  const Pose T_W_X = testing::LookAt({0, 0.1, 1.45}, {6, 0, 1.3});
  const RangeImage image = RangeImage::FromDepth(scene.RenderDepth(T_W_X, {}), 20.0);
  const Eigen::Matrix3Xf bridges = BridgeGaps(image, ObjectId(5), kVoxel);
  for (Eigen::Index i = 0; i < bridges.cols(); ++i) {
    EXPECT_LT(std::abs(scene.Distance(T_W_X * bridges.col(i).cast<double>())), 0.5 * kVoxel);
  }
  EXPECT_EQ(BridgeGaps(image, ObjectId(6), kVoxel).cols(), 0);
}

TEST(GapBridging, NoiseIsNotBridged) {
  const testing::ViewedScene scene = testing::PlaneScene();
  const RangeImage image =
      RangeImage::FromDepth(scene.scene.RenderDepth(scene.views[0], {}, 0.05, 1), 20.0);
  BridgeOptions options;
  options.noise_m = 0.05;
  EXPECT_EQ(BridgeGaps(image, kStaticWorld, kVoxel, options).cols(), 0);
}

TEST(GapBridging, BridgesNeverReplaceMeasuredVoxels) {
  const AnalyticScene scene("ground", {Ground()});
  const Pose T_W_X = At(0.3, 0.1, 1.7);
  const PointCloud cloud = scene.RenderLidar(T_W_X, {});
  std::vector<uint32_t> returns;
  for (Eigen::Index i = 0; i < cloud.points_X.cols(); ++i) {
    if (!cloud.points_X.col(i).isZero()) returns.push_back(static_cast<uint32_t>(i));
  }
  const LocalVoxels measured = GatherVoxels(cloud.points_X, returns, T_W_X, 0.2);
  const RangeImage image = RangeImage::FromCloud(cloud, 0.001, 40.0);
  const LocalVoxels all = WithBridges(measured, image, T_W_X, kStaticWorld, 0);
  EXPECT_GT(all.offset.size(), measured.offset.size());
  size_t block = 0;
  for (const LocalVoxels::Block& b : measured.blocks) {
    while (all.blocks[block].block < b.block) ++block;
    ASSERT_EQ(all.blocks[block].block, b.block);
    uint32_t j = all.blocks[block].begin;
    for (uint32_t i = b.begin; i < b.end; ++i) {
      while (all.offset[j] < measured.offset[i]) ++j;
      ASSERT_EQ(all.offset[j], measured.offset[i]);
      EXPECT_EQ(all.centroid[j], measured.centroid[i]);
      EXPECT_EQ(all.count[j], measured.count[i]);
    }
  }
}

}  // namespace
}  // namespace clearance
