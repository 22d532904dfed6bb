#include "server/integration/local_voxels.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <map>
#include <numeric>
#include <random>

namespace clearance {
namespace {

struct Cell {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  uint32_t count = 0;
};

struct Order {
  bool operator()(const VoxelIndex& a, const VoxelIndex& b) const {
    const BlockIndex p = BlockOf(a), q = BlockOf(b);
    return p != q ? p < q : OffsetOf(a) < OffsetOf(b);
  }
};

Pose SomePose(uint32_t seed, double far_m) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> g;
  Pose T = Pose::Identity();
  T.linear() = Eigen::Quaterniond(g(rng), g(rng), g(rng), g(rng)).normalized().toRotationMatrix();
  T.translation() = Eigen::Vector3d(far_m * g(rng), far_m * g(rng), g(rng));
  return T;
}

// Points in rows, as a sensor gives them, so that neighbours share voxels.
Eigen::Matrix3Xf SomePoints(int n, uint32_t seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<float> g;
  Eigen::Matrix3Xf points(3, n);
  for (int i = 0; i < n; ++i) {
    points.col(i) << 8 * std::sin(0.001f * i), 0.002f * (i % 4000) - 4, 3 + 0.02f * g(rng);
  }
  return points;
}

std::vector<uint32_t> All(const Eigen::Matrix3Xf& points) {
  std::vector<uint32_t> indices(points.cols());
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

void ExpectSame(const LocalVoxels& a, const LocalVoxels& b) {
  ASSERT_EQ(a.offset, b.offset);
  EXPECT_EQ(a.count, b.count);
  for (size_t i = 0; i < a.centroid.size(); ++i) ASSERT_EQ(a.centroid[i], b.centroid[i]);
  ASSERT_EQ(a.blocks.size(), b.blocks.size());
  for (size_t i = 0; i < a.blocks.size(); ++i) EXPECT_EQ(a.blocks[i].block, b.blocks[i].block);
}

TEST(GatherVoxels, EqualsBruteForceNearAndFarFromTheOrigin) {
  const double h = 0.1;
  for (double far_m : {1.0, 10'000.0}) {
    for (uint32_t seed = 0; seed < 3; ++seed) {
      const Pose T_M_X = SomePose(seed, far_m);
      const Eigen::Matrix3Xf points = SomePoints(50'000, seed);
      std::map<VoxelIndex, Cell, Order> truth;
      for (Eigen::Index i = 0; i < points.cols(); ++i) {
        const Eigen::Vector3d p = T_M_X * points.col(i).cast<double>();
        Cell& c = truth[VoxelOf(p, h)];
        c.sum += p;
        ++c.count;
      }
      const LocalVoxels voxels = GatherVoxels(points, All(points), T_M_X, h);
      // A point on a voxel's border may fall to either side by rounding.
      size_t total = 0, agreeing = 0;
      for (const LocalVoxels::Block& b : voxels.blocks) {
        for (uint32_t i = b.begin; i < b.end; ++i) {
          total += voxels.count[i];
          const auto it = truth.find(VoxelAt(b.block, voxels.offset[i]));
          if (it == truth.end() || it->second.count != voxels.count[i]) continue;
          const Eigen::Vector3d p = BlockOrigin(b.block, h) + voxels.centroid[i].cast<double>();
          agreeing += (p - it->second.sum / it->second.count).norm() < 1e-5;
          EXPECT_EQ(VoxelOf(p + 1e-9 * (VoxelCentre(it->first, h) - p), h), it->first);
        }
      }
      EXPECT_EQ(total, 50'000u);
      EXPECT_GE(agreeing, voxels.offset.size() - 8) << far_m << " " << seed;
      EXPECT_NEAR(voxels.offset.size(), truth.size(), 2);
    }
  }
}

TEST(GatherVoxels, BlocksAndOffsetsRise) {
  const Eigen::Matrix3Xf points = SomePoints(30'000, 1);
  const LocalVoxels voxels = GatherVoxels(points, All(points), SomePose(4, 3.0), 0.2);
  uint32_t next = 0;
  for (size_t b = 0; b < voxels.blocks.size(); ++b) {
    if (b > 0) {
      EXPECT_LT(voxels.blocks[b - 1].block, voxels.blocks[b].block);
    }
    EXPECT_EQ(voxels.blocks[b].begin, next);
    EXPECT_GT(voxels.blocks[b].end, next);
    next = voxels.blocks[b].end;
    for (uint32_t i = voxels.blocks[b].begin + 1; i < next; ++i) {
      EXPECT_LT(voxels.offset[i - 1], voxels.offset[i]);
    }
  }
  EXPECT_EQ(next, voxels.offset.size());
}

TEST(GatherVoxels, DoesNotDependOnTheNumberOfThreads) {
  const Eigen::Matrix3Xf points = SomePoints(200'000, 2);
  const Pose T = SomePose(9, 100.0);
  const LocalVoxels many = GatherVoxels(points, All(points), T, 0.05);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  ExpectSame(many, GatherVoxels(points, All(points), T, 0.05));
}

TEST(GatherVoxels, TakesOnlyTheGivenPoints) {
  const Eigen::Matrix3Xf points = SomePoints(1000, 3);
  std::vector<uint32_t> odd;
  Eigen::Matrix3Xf odd_points(3, 500);
  for (uint32_t i = 1; i < 1000; i += 2) {
    odd_points.col(odd.size()) = points.col(i);
    odd.push_back(i);
  }
  const Pose T = SomePose(1, 5.0);
  ExpectSame(GatherVoxels(points, odd, T, 0.1), GatherVoxels(odd_points, All(odd_points), T, 0.1));
  EXPECT_TRUE(GatherVoxels(points, {}, T, 0.1).empty());
}

}  // namespace
}  // namespace clearance
