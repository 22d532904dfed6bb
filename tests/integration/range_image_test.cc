#include "server/integration/range_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <random>

#include "tests/testing/analytic_scene.h"

namespace clearance {
namespace {

using testing::AnalyticScene;

DepthImage Ramp() {
  DepthImage d;
  d.width = 64, d.height = 48;
  d.fx = 50, d.fy = 60, d.cx = 30.5, d.cy = 22.25;
  d.depth_scale_m = 0.001;
  for (uint32_t i = 0; i < d.width * d.height; ++i) d.depth.push_back(1000 + i);
  d.labels.assign(d.depth.size(), 0);
  d.labels[5 * 64 + 7] = 9;
  d.depth[3] = 0;
  return d;
}

// A lidar's returns from a sphere around it: ranges depend on the direction alone.
PointCloud Shell(double from_rad, double to_rad, int columns, int rows, uint32_t seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> jitter(-0.2, 0.2);
  PointCloud cloud;
  cloud.points_X.resize(3, columns * rows);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const double a = from_rad + (to_rad - from_rad) * (c + 0.5 + jitter(rng)) / columns;
      const double e = -0.4 + 0.8 * (r + 0.5 + jitter(rng)) / rows;
      const double range_m = 5 + std::cos(3 * a) + std::sin(5 * e);
      cloud.points_X.col(r * columns + c) =
          (range_m *
           Eigen::Vector3d(std::cos(a) * std::cos(e), std::sin(a) * std::cos(e), std::sin(e)))
              .cast<float>();
      cloud.labels.push_back(static_cast<uint16_t>(1 + c * 7 / columns));
    }
  }
  return cloud;
}

TEST(RangeImage, UnprojectsAndProjectsDepthPixelsOntoThemselves) {
  const RangeImage image = RangeImage::FromDepth(Ramp(), 25.0);
  ASSERT_TRUE(image.is_pinhole());
  for (int v = 0; v < image.height(); ++v) {
    for (int u = 0; u < image.width(); ++u) {
      if (image.measure(u, v) == 0.f) continue;
      const Eigen::Vector3f p = image.Point(u, v);
      EXPECT_NEAR(p.x(), p.z() * (u - 30.5) / 50, 1e-5);
      EXPECT_NEAR(p.y(), p.z() * (v - 22.25) / 60, 1e-5);
      const auto at = image.Project(p);
      ASSERT_TRUE(at.has_value());
      EXPECT_NEAR(at->u, u, 1e-3);
      EXPECT_NEAR(at->v, v, 1e-3);
      EXPECT_FLOAT_EQ(at->measure, image.measure(u, v));
    }
  }
  EXPECT_EQ(image.label(7, 5), 9);
  EXPECT_EQ(image.label(8, 5), 0);
}

TEST(RangeImage, ProjectsNothingBehindTheCameraOrBesideTheImage) {
  const RangeImage image = RangeImage::FromDepth(Ramp(), 25.0);
  EXPECT_FALSE(image.Project({0, 0, -1}).has_value());
  EXPECT_FALSE(image.Project({0, 0, 0}).has_value());
  EXPECT_FALSE(image.Project({5, 0, 1}).has_value());
  EXPECT_FALSE(image.Project({0, -5, 1}).has_value());
}

TEST(RangeImage, KeepsFarReturnsForFreeSpaceButNotAsSurface) {
  const RangeImage image = RangeImage::FromDepth(Ramp(), 2.0);
  EXPECT_FALSE(image.has_surface(3, 0)) << "no return";
  EXPECT_TRUE(image.has_surface(4, 0));
  EXPECT_GT(image.measure(63, 47), 4.f);
  EXPECT_FALSE(image.has_surface(63, 47));
}

TEST(RangeImage, BoxesHoldEachLabelTightly) {
  DepthImage d;
  d.width = 67;  // no multiple of four
  d.height = 31;
  d.fx = d.fy = 60;
  d.depth.assign(size_t{d.width} * d.height, 2000);
  d.labels.assign(d.depth.size(), 0);
  std::mt19937 rng(3);
  std::map<uint16_t, Eigen::AlignedBox2i> expected;
  for (int n = 0; n < 40; ++n) {
    const int u = static_cast<int>(rng() % d.width), v = static_cast<int>(rng() % d.height);
    const uint16_t label = static_cast<uint16_t>(n < 2 ? 700 : 1 + rng() % 5);
    uint16_t& at = d.labels[static_cast<size_t>(v) * d.width + u];
    if (at == 0) expected[at = label].extend(Eigen::Vector2i(u, v));
  }
  const RangeImage image = RangeImage::FromDepth(d, 10);
  for (const auto& [label, box] : expected) {
    const RangeImage::PixelBox found = image.BoxOf(label);
    EXPECT_EQ(found.u0, box.min().x()) << label;
    EXPECT_EQ(found.v0, box.min().y()) << label;
    EXPECT_EQ(found.u1, box.max().x()) << label;
    EXPECT_EQ(found.v1, box.max().y()) << label;
  }
  EXPECT_TRUE(image.BoxOf(99).empty());
  EXPECT_EQ(image.BoxOf(0).u1, 66);
}

TEST(RangeImage, FindsEachPointOfAnUnorganisedCloudWhereItLies) {
  // Half a circle to the left, one across +-180 degrees, and a full circle.
  for (const auto& [from, to] : {std::pair{-0.7, 2.1}, {2.0, 4.9}, {-3.0, 3.0}, {0.0, 6.283}}) {
    const PointCloud cloud = Shell(from, to, 400, 100, 3);
    const RangeImage image = RangeImage::FromCloud(cloud, 0.001, 40.0);
    int lost = 0, nearer = 0;
    for (Eigen::Index i = 0; i < cloud.points_X.cols(); ++i) {
      const Eigen::Vector3f p = cloud.points_X.col(i);
      const auto at = image.Project(p);
      if (!at) {
        ++lost;
        continue;
      }
      EXPECT_NEAR(at->measure, p.norm(), 1e-4);
      const int u = static_cast<int>(std::lround(at->u)), v = static_cast<int>(std::lround(at->v));
      const float measure = image.measure(u, v);
      EXPECT_GT(measure, 0.f);
      EXPECT_LE(measure, p.norm() + 1e-5f) << "the nearest return of a pixel wins";
      if (image.Point(u, v) == p) {
        EXPECT_EQ(image.label(u, v), cloud.labels[i]);
      } else {
        ++nearer;
      }
    }
    EXPECT_LE(lost, 2);
    EXPECT_LT(nearer, cloud.points_X.cols() * 0.45) << "most returns have a pixel of their own";
    EXPECT_LT(image.width() * image.height(), 2 * cloud.points_X.cols());
  }
}

TEST(RangeImage, ClosesUponItselfOnlyForAFullCircle) {
  const RangeImage full = RangeImage::FromCloud(Shell(0, 6.283, 512, 64, 1), 0.001, 40.0);
  EXPECT_TRUE(full.wraps());
  EXPECT_NEAR(full.width() * full.pixel_rad(), 2 * std::numbers::pi, 0.05);
  const RangeImage half = RangeImage::FromCloud(Shell(1.6, 4.7, 256, 64, 1), 0.001, 40.0);
  EXPECT_FALSE(half.wraps());
  EXPECT_NEAR(half.width() * half.pixel_rad(), 3.1, 0.05);
  EXPECT_FALSE(half.Project({5, 0, 0}).has_value()) << "ahead is outside of the view to the back";
  EXPECT_TRUE(half.Project({-5, 0.01f, 0}).has_value());
  EXPECT_TRUE(half.Project({-5, -0.01f, 0}).has_value());
}

TEST(RangeImage, ReadsOrganisedCloudsWithMissingReturns) {
  testing::LidarModel lidar;
  const AnalyticScene scene = testing::BoxScene().scene;
  Pose T_W_X = Pose::Identity();
  T_W_X.translation() = Eigen::Vector3d(3, 1, 1.2);
  const PointCloud cloud = scene.RenderLidar(T_W_X, lidar);
  ASSERT_EQ(cloud.points_X.cols(), lidar.rows * lidar.columns);
  const RangeImage image = RangeImage::FromCloud(cloud, 0.002, lidar.max_range_m);
  int returns = 0, pixels = 0, missing = 0;
  for (Eigen::Index i = 0; i < cloud.points_X.cols(); ++i) {
    (cloud.points_X.col(i).isZero(0) ? missing : returns)++;
  }
  for (const float m : image.measures()) pixels += m > 0.f;
  EXPECT_GT(missing, 0);
  EXPECT_GT(pixels, returns / 2);
  EXPECT_LE(pixels, returns);
}

TEST(RangeImage, ProjectsEightPointsAsItProjectsOne) {
  const RangeImage image = RangeImage::FromCloud(Shell(1.0, 5.5, 300, 80, 5), 0.001, 40.0);
  std::mt19937 rng(4);
  std::uniform_real_distribution<float> uniform(-6, 6), small(-0.3f, 0.3f);
  int inside = 0;
  for (int n = 0; n < 500; ++n) {
    const Eigen::Vector3f first(uniform(rng), uniform(rng), 0.3f * uniform(rng));
    const Eigen::Vector3f step(small(rng), small(rng), small(rng));
    const auto eight = image.ProjectEight(first, step);
    for (int k = 0; k < 8; ++k) {
      const auto one = image.Project(first + static_cast<float>(k) * step);
      if (!one) continue;
      // Rounding may differ on the border between two pixels.
      if (std::abs(one->u - std::floor(one->u) - 0.5f) < 1e-2f) continue;
      if (std::abs(one->v - std::floor(one->v) - 0.5f) < 1e-2f) continue;
      ASSERT_TRUE(eight.inside[k]);
      EXPECT_EQ(eight.u[k], static_cast<int>(std::lround(one->u)));
      EXPECT_EQ(eight.v[k], static_cast<int>(std::lround(one->v)));
      EXPECT_NEAR(eight.measure[k], one->measure, 1e-4);
      ++inside;
    }
  }
  EXPECT_GT(inside, 500);
}

TEST(RangeImage, IsEmptyForACloudWithoutReturns) {
  PointCloud cloud;
  EXPECT_EQ(RangeImage::FromCloud(cloud, 0.001, 40).width(), 0);
  cloud.points_X.setZero(3, 100);
  const RangeImage image = RangeImage::FromCloud(cloud, 0.001, 40);
  EXPECT_EQ(image.width(), 0);
  EXPECT_FALSE(image.Project({1, 2, 3}).has_value());
}

TEST(RangeImage, StaysSmallForOddClouds) {
  PointCloud cloud;
  cloud.points_X.resize(3, 3);
  cloud.points_X << 1, 0, 0.001f, 0, -1, 0, 0, 0.5f, 1;  // three far directions
  const RangeImage image = RangeImage::FromCloud(cloud, 1e-6, 40);
  EXPECT_LE(image.measures().size(), 400u * 200u);
  cloud.points_X.setOnes(3, 3);  // one direction only
  const RangeImage one = RangeImage::FromCloud(cloud, 0.0, 40);
  EXPECT_EQ(one.width(), 1);
  EXPECT_EQ(one.height(), 1);
}

}  // namespace
}  // namespace clearance
