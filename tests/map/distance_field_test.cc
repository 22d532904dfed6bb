#include "server/map/distance_field.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>
#include <set>

namespace clearance {
namespace {

Eigen::Vector3f RandomUnit(std::mt19937& rng) {
  std::normal_distribution<float> normal;
  return Eigen::Vector3f(normal(rng), normal(rng), normal(rng)).normalized();
}

float DegreesBetween(const Eigen::Vector3f& a, const Eigen::Vector3f& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180.f / 3.14159265f;
}

TEST(NormalCode, IsWithinTwelveDegreesOfEveryDirection) {
  std::mt19937 rng(3);
  float worst = 0;
  for (int i = 0; i < 200000; ++i) {
    const Eigen::Vector3f n = RandomUnit(rng);
    worst = std::max(worst, DegreesBetween(n, NormalOfCode(CodeOfNormal(n))));
  }
  EXPECT_LT(worst, 12.f);
}

TEST(NormalCode, IsTheNearestOfAllCodes) {
  std::mt19937 rng(4);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3f n = RandomUnit(rng);
    float best = -1;
    for (int code = 0; code < 128; ++code) best = std::max(best, n.dot(NormalOfCode(code)));
    EXPECT_NEAR(n.dot(NormalOfCode(CodeOfNormal(n))), best, 1e-6f);
  }
}

TEST(NormalCode, KeepsAxesEdgesAndCornersExact) {
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        if (x == 0 && y == 0 && z == 0) continue;
        const Eigen::Vector3f n = Eigen::Vector3f(x, y, z).normalized();
        EXPECT_LT((NormalOfCode(CodeOfNormal(n)) - n).norm(), 1e-6f) << n.transpose();
      }
    }
  }
}

TEST(NormalCode, CodesRoundTripAndDecodeToUnitVectors) {
  std::set<int> codes;
  for (int code = 0; code < 128; ++code) {
    EXPECT_NEAR(NormalOfCode(code).norm(), 1.f, 1e-6f);
    codes.insert(CodeOfNormal(NormalOfCode(code)));
  }
  EXPECT_EQ(codes.size(), 122u);
  for (int code : codes) EXPECT_EQ(CodeOfNormal(NormalOfCode(code)), code);
}

TEST(SigmaCode, CoversOneSixtyFourthToTwoVoxelsInEqualRatios) {
  EXPECT_FLOAT_EQ(SigmaVoxelsOfCode(0), 1.f / 64.f);
  EXPECT_NEAR(SigmaVoxelsOfCode(31), 2.f, 1e-5f);
  for (int code = 0; code < 32; ++code) {
    EXPECT_EQ(CodeOfSigmaVoxels(SigmaVoxelsOfCode(code)), code);
  }
  for (float sigma = 0.016f; sigma < 2; sigma *= 1.01f) {
    EXPECT_NEAR(SigmaVoxelsOfCode(CodeOfSigmaVoxels(sigma)) / sigma, 1.f, 0.085f);
  }
}

TEST(SigmaCode, ClampsWhatItCannotHold) {
  EXPECT_EQ(CodeOfSigmaVoxels(0), 0);
  EXPECT_EQ(CodeOfSigmaVoxels(1e-6f), 0);
  EXPECT_EQ(CodeOfSigmaVoxels(1e6f), 31);
  EXPECT_EQ(CodeOfSigmaVoxels(std::numeric_limits<float>::quiet_NaN()), 0);
}

TEST(FieldVoxel, UnpacksItsAttributes) {
  FieldVoxel v;
  EXPECT_FALSE(v.has_site());
  EXPECT_EQ(v.state(), VoxelState::kUnknown);
  v = {256, -128, 64, static_cast<uint16_t>(1 | 4 | (17 << 4) | (99 << 9))};
  EXPECT_TRUE(v.has_site());
  EXPECT_EQ(v.state(), VoxelState::kFree);
  EXPECT_TRUE(v.low_confidence());
  EXPECT_FALSE(v.negative());
  EXPECT_EQ(v.sigma_code(), 17);
  EXPECT_EQ(v.normal_code(), 99);
  EXPECT_EQ(v.to_site_voxels(), Eigen::Vector3f(1.f, -0.5f, 0.25f));
}

std::shared_ptr<const FieldBlock> BlockWith(int16_t value) {
  auto block = std::make_shared<FieldBlock>();
  for (int o = 0; o < kBlockVoxels; ++o) {
    block->voxels[o] = {value, static_cast<int16_t>(o), 0, 2};
  }
  return block;
}

TEST(DistanceField, FindsVoxelsInEveryOctantAndFarFromTheOrigin) {
  DistanceField field(0.1, 5.0);
  const std::vector<BlockIndex> blocks = {
      {0, 0, 0}, {-1, -1, -1}, {7, 8, -8}, {-9, 3, 5}, {125000, -125000, 12500}};
  for (size_t i = 0; i < blocks.size(); ++i) field.Set(blocks[i], BlockWith(100 + i));
  EXPECT_EQ(field.BlockCount(), blocks.size());
  for (size_t i = 0; i < blocks.size(); ++i) {
    for (int o : {0, 7, 63, 64, 511}) {
      const FieldVoxel v = field.At(VoxelAt(blocks[i], o));
      EXPECT_EQ(v.dx, static_cast<int16_t>(100 + i));
      EXPECT_EQ(v.dy, o);
    }
  }
  EXPECT_FALSE(field.At({8, 0, 0}).has_site());
  EXPECT_EQ(field.At({8, 0, 0}).state(), VoxelState::kUnknown);
}

TEST(DistanceField, AnswersFromATileWithoutSites) {
  DistanceField field(0.1, 5.0);
  const uint8_t free_low = static_cast<uint8_t>(VoxelState::kFree) | 4;
  field.Set({-3, 0, 2}, nullptr, free_low);
  const FieldVoxel v = field.At(VoxelAt({-3, 0, 2}, 200));
  EXPECT_FALSE(v.has_site());
  EXPECT_EQ(v.state(), VoxelState::kFree);
  EXPECT_TRUE(v.low_confidence());
  EXPECT_EQ(field.BlockCount(), 0u);
}

TEST(DistanceField, KeepsAnOlderCopyUnchanged) {
  DistanceField field(0.1, 5.0);
  field.Set({0, 0, 0}, BlockWith(1));
  field.Set({0, 0, 1}, BlockWith(2));
  const DistanceField before = field;
  field.Set({0, 0, 0}, BlockWith(10));
  field.Set({0, 0, 1}, nullptr);
  field.Set({0, 0, 2}, nullptr, 1);
  EXPECT_EQ(before.At({0, 0, 0}).dx, 1);
  EXPECT_EQ(before.At({0, 0, 8}).dx, 2);
  EXPECT_EQ(before.At({0, 0, 16}).state(), VoxelState::kUnknown);
  EXPECT_EQ(field.At({0, 0, 0}).dx, 10);
  EXPECT_FALSE(field.At({0, 0, 8}).has_site());
  EXPECT_EQ(field.At({0, 0, 16}).state(), VoxelState::kFree);
}

TEST(DistanceField, IsEmptyAgainWhenEverythingWasRemoved) {
  DistanceField field(0.1, 5.0);
  field.Set({5, 5, 5}, BlockWith(1));
  field.Set({-5, 5, 5}, nullptr, 2);
  field.Set({5, 5, 5}, nullptr);
  field.Set({-5, 5, 5}, nullptr);
  field.Set({50, 50, 50}, nullptr);
  EXPECT_TRUE(field.empty());
}

TEST(DistanceField, VisitsWhatItStoresInSortedOrder) {
  DistanceField field(0.1, 5.0);
  std::mt19937 rng(5);
  std::uniform_int_distribution<int> coordinate(-20, 20);
  std::set<BlockIndex> expected;
  for (int i = 0; i < 200; ++i) {
    const BlockIndex b{coordinate(rng), coordinate(rng), coordinate(rng)};
    expected.insert(b);
    field.Set(b, i % 3 ? BlockWith(i) : nullptr, 1);
  }
  std::vector<BlockIndex> visited;
  field.ForEach(
      [&](const BlockIndex& b, const std::shared_ptr<const FieldBlock>& data, uint8_t tile) {
        visited.push_back(b);
        EXPECT_NE(data == nullptr, tile == DistanceField::kNoTile);
      });
  EXPECT_THAT(visited, ::testing::ElementsAreArray(expected));
}

}  // namespace
}  // namespace clearance
