// States, flags, limits and validation of point queries.
#include "server/query/point_query.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "tests/query/query_fixture.h"

namespace clearance {
namespace {

using state_byte::kClamped;
using state_byte::kLowConfidence;
using state_byte::kNoGradient;
using state_byte::kOutsideBounds;
using state_byte::kStale;
using state_byte::kStateMask;
using ::testing::HasSubstr;

constexpr double kVoxel = 0.1;
constexpr double kMax = 2.0;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

constexpr double kFloor = -0.03;

double FloorDistance(const Eigen::Vector3d& p) { return p.z() - kFloor; }

MapView FloorView() {
  return testing::ViewOf(
      testing::ExactField(FloorDistance, {Eigen::Vector3d(-2, -2, -1), Eigen::Vector3d(2, 2, 3)},
                          kVoxel, kMax),
      kMax);
}

TEST(PointQuery, ReportsTheStateOfThePointsOwnVoxel) {
  // Random states; a block missing, a block that is a tile.
  DistanceField field(kVoxel, kMax);
  std::mt19937 rng(1);
  for (int x = -2; x < 2; ++x) {
    for (int y = -2; y < 2; ++y) {
      for (int z = -2; z < 2; ++z) {
        auto block = std::make_shared<FieldBlock>();
        for (FieldVoxel& voxel : block->voxels) {
          voxel.attributes = static_cast<uint16_t>(rng() % 3) | (rng() % 2 ? 4 : 0);
        }
        if (x == 1 && y == 1) continue;
        if (x == 1 && y == 0) {
          field.Set({x, y, z}, nullptr, 1 | 4);
        } else {
          field.Set({x, y, z}, block);
        }
      }
    }
  }
  const MapView view = testing::ViewOf(field, kMax);
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d p =
        testing::RandomIn({Eigen::Vector3d(-1.8, -1.8, -1.8), Eigen::Vector3d(1.8, 1.8, 1.8)}, rng);
    const FieldVoxel own = view.field.At(VoxelOf(p, kVoxel));
    const uint8_t state = QueryDistances(view, p).states[0];
    ASSERT_EQ(state & kStateMask, static_cast<int>(own.state()));
    ASSERT_EQ((state & kLowConfidence) != 0, own.low_confidence());
    ASSERT_TRUE(state & kClamped);
  }
}

TEST(PointQuery, HoldsTheVoxelsStateAndThePointsDistanceAtOnce) {
  const MapView view = FloorView();
  // Above the floor, in the voxel that the floor passes through.
  const DistanceBatch before = QueryDistances(view, Eigen::Vector3d(0.33, 0.21, kFloor + 0.02));
  EXPECT_NEAR(before.distances_m[0], 0.02, 0.003);
  EXPECT_EQ(before.states[0] & kStateMask, 2);
  const DistanceBatch above = QueryDistances(view, Eigen::Vector3d(0.33, 0.21, kFloor + 0.05));
  EXPECT_NEAR(above.distances_m[0], 0.05, 0.003);
  EXPECT_EQ(above.states[0] & kStateMask, 1);
  const DistanceBatch below = QueryDistances(view, Eigen::Vector3d(0.33, 0.21, kFloor - 0.2));
  EXPECT_NEAR(below.distances_m[0], -0.2, 0.01);
  EXPECT_EQ(below.states[0] & kStateMask, 2);
}

TEST(PointQuery, ClampsWithAFlagAndWithoutGradient) {
  const MapView view = FloorView();
  const Eigen::Vector3d p(0, 0, kFloor + 1.5);
  const DistanceBatch whole = QueryDistances(view, p, {.gradients = true});
  EXPECT_NEAR(whole.distances_m[0], 1.5, 0.01);
  EXPECT_FALSE(whole.states[0] & (kClamped | kNoGradient));
  EXPECT_NEAR(whole.gradients_W(2, 0), 1, 0.02);
  const DistanceBatch less = QueryDistances(view, p, {.gradients = true, .max_distance_m = 1});
  EXPECT_EQ(less.distances_m[0], 1.f);
  EXPECT_TRUE(less.states[0] & kClamped);
  EXPECT_TRUE(less.states[0] & kNoGradient);
  EXPECT_TRUE(less.gradients_W.col(0).isZero(0.f));
  // More than the map's maximum is the map's.
  const DistanceBatch more =
      QueryDistances(view, Eigen::Vector3d(0, 0, 2.9), {.max_distance_m = 9});
  EXPECT_EQ(more.distances_m[0], static_cast<float>(kMax));
  EXPECT_TRUE(more.states[0] & kClamped);
  // Deep inside: clamped too, but the way out is known.
  const DistanceBatch deep = QueryDistances(view, Eigen::Vector3d(0, 0, kFloor - 0.9),
                                            {.gradients = true, .max_distance_m = 0.5});
  EXPECT_EQ(deep.distances_m[0], -0.5f);
  EXPECT_TRUE(deep.states[0] & kClamped);
  EXPECT_NEAR(deep.gradients_W(2, 0), 1, 0.02);
}

TEST(PointQuery, SubtractsTheMarginOfTheStaticSigma) {
  const MapView view = FloorView();
  const Eigen::Vector3d p(0, 0, kFloor + 1);
  const DistanceBatch plain = QueryDistances(view, p, {.sigmas = true});
  const double sigma_m = kVoxel * SigmaVoxelsOfCode(CodeOfSigmaVoxels(0.1f));
  EXPECT_NEAR(plain.sigmas_m[0], sigma_m, 1e-6);
  const DistanceBatch with = QueryDistances(view, p, {.sigma_margin = 3});
  EXPECT_NEAR(with.distances_m[0], plain.distances_m[0] - 3 * sigma_m, 1e-5);
}

TEST(PointQuery, AnswersWhatIsNotAPlaceWithFiniteNumbers) {
  const MapView view = FloorView();
  Eigen::Matrix3Xd points(3, 6);
  points.col(0) << kNaN, 0, 0;
  points.col(1) << 0, kInfinity, 0;
  points.col(2) << 0, 0, -kInfinity;
  points.col(3) << 1e300, 0, 0;
  points.col(4) << 1e9, -1e9, 0;
  points.col(5) << 0, 0, kFloor + 0.5;  // a good one among them
  const DistanceBatch batch = QueryDistances(
      view, points,
      {.gradients = true, .objects = true, .sigmas = true, .unknown_distances = true});
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(batch.distances_m[i], static_cast<float>(kMax));
    EXPECT_EQ(batch.states[i], kClamped | kNoGradient | kOutsideBounds);
    EXPECT_TRUE(batch.gradients_W.col(i).isZero(0.f));
    EXPECT_EQ(batch.unknown_distances_m[i], 0.f);
    EXPECT_EQ(batch.sigmas_m[i], 0.f);
    EXPECT_EQ(batch.object_ids[i], 0u);
  }
  EXPECT_NEAR(batch.distances_m[5], 0.5, 0.01);
}

TEST(PointQuery, FlagsPointsOutsideTheBoundsAndStaleViews) {
  MapView view = FloorView();
  view.config.bounds = Aabb(Eigen::Vector3d(-1, -1, -1), Eigen::Vector3d(1, 1, 1));
  const DistanceBatch outside = QueryDistances(view, Eigen::Vector3d(1.5, 0, kFloor + 0.5));
  EXPECT_EQ(outside.states[0], kOutsideBounds);
  EXPECT_NEAR(outside.distances_m[0], 0.5, 0.01);
  const Eigen::Vector3d p(0.5, 0, 0.5);
  EXPECT_EQ(QueryDistances(view, p).states[0], 1);
  view.config.stale_after_s = 1;
  const auto fresh = view.published_at + std::chrono::milliseconds(900);
  const auto old = view.published_at + std::chrono::milliseconds(1100);
  EXPECT_EQ(QueryDistances(view, p, {.now = fresh}).states[0], 1);
  EXPECT_EQ(QueryDistances(view, p, {.now = old}).states[0], 1 | kStale);
}

TEST(PointQuery, AnEmptyMapIsUnknownEverywhere) {
  const MapView view = testing::ViewOf(DistanceField(kVoxel, kMax), kMax);
  const DistanceBatch batch = QueryDistances(view, Eigen::Vector3d(3, -4, 5),
                                             {.gradients = true, .unknown_distances = true});
  EXPECT_EQ(batch.states[0], kClamped | kNoGradient);
  EXPECT_EQ(batch.distances_m[0], static_cast<float>(kMax));
  EXPECT_EQ(batch.unknown_distances_m[0], 0.f);
  EXPECT_TRUE(QueryDistances(view, Eigen::Matrix3Xd(3, 0)).distances_m.empty());
}

TEST(PointQuery, AnswersDoNotDependOnTheBatch) {
  MapView view = FloorView();
  Pose T_W_L = testing::RandomPose(3, 1);
  testing::AddObject(view, 4, testing::CarShape(kVoxel), T_W_L).screw_W << 1, 2, 0, 0, 0, 0.3;
  view.object_index = BuildObjectIndex(view.objects);
  std::mt19937 rng(2);
  Eigen::Matrix3Xd points(3, 20000);
  for (int i = 0; i < points.cols(); ++i) {
    points.col(i) = testing::RandomIn({Eigen::Vector3d(-4, -4, -2), Eigen::Vector3d(4, 4, 4)}, rng);
  }
  QueryOptions options{.horizon_s = 0.4,
                       .gradients = true,
                       .objects = true,
                       .sigmas = true,
                       .unknown_distances = true};
  const DistanceBatch parallel = QueryDistances(view, points, options);
  options.parallel = false;
  const DistanceBatch serial = QueryDistances(view, points, options);
  EXPECT_EQ(parallel.distances_m, serial.distances_m);
  EXPECT_EQ(parallel.states, serial.states);
  EXPECT_EQ(parallel.gradients_W, serial.gradients_W);
  EXPECT_EQ(parallel.object_ids, serial.object_ids);
  EXPECT_EQ(parallel.sigmas_m, serial.sigmas_m);
  EXPECT_EQ(parallel.unknown_distances_m, serial.unknown_distances_m);
  for (int i = 0; i < 2000; ++i) {
    const int column = static_cast<int>(rng() % 20000);
    const DistanceBatch one = QueryDistances(view, points.col(column), options);
    ASSERT_EQ(one.distances_m[0], serial.distances_m[column]);
    ASSERT_EQ(one.states[0], serial.states[column]);
    ASSERT_EQ(one.gradients_W.col(0), serial.gradients_W.col(column));
    ASSERT_EQ(one.unknown_distances_m[0], serial.unknown_distances_m[column]);
  }
}

TEST(UnknownDistance, EqualsBruteForceOverTheCubes) {
  for (const BlockIndex& base :
       {BlockIndex{0, 0, 0}, BlockIndex{-3, 7, -9}, BlockIndex{12500, 3, -2}}) {
    // Known with holes: sparse unknown voxels, a tile of free space, one block missing.
    DistanceField field(kVoxel, kMax);
    std::mt19937 rng(5);
    std::vector<VoxelIndex> unknown;
    constexpr int kSide = 5;
    for (int x = 0; x < kSide; ++x) {
      for (int y = 0; y < kSide; ++y) {
        for (int z = 0; z < kSide; ++z) {
          const BlockIndex index{base.x + x, base.y + y, base.z + z};
          if (x == 2 && y == 2 && z == 1) {
            for (int i = 0; i < kBlockVoxels; ++i) unknown.push_back(VoxelAt(index, i));
            continue;
          }
          if (x == 1) {
            field.Set(index, nullptr, 1);
            continue;
          }
          auto block = std::make_shared<FieldBlock>();
          for (int i = 0; i < kBlockVoxels; ++i) {
            const bool hole = rng() % 3000 == 0;
            block->voxels[i].attributes = hole ? 0 : 1 + rng() % 2;
            if (hole) unknown.push_back(VoxelAt(index, i));
          }
          field.Set(index, block);
        }
      }
    }
    const MapView view = testing::ViewOf(field, kMax);
    const Eigen::Vector3d low = BlockOrigin(base, kVoxel);
    const Eigen::Vector3d high = low + Eigen::Vector3d::Constant(kSide * 8 * kVoxel);
    for (int i = 0; i < 1000; ++i) {
      const Eigen::Vector3d p = testing::RandomIn({low, high}, rng);
      // Everything beyond the five blocks is unknown.
      double truth = std::min({kMax, (p - low).minCoeff(), (high - p).minCoeff()});
      for (const VoxelIndex& voxel : unknown) {
        const Eigen::Vector3d centre = VoxelCentre(voxel, kVoxel);
        const Eigen::Vector3d outside =
            ((p - centre).cwiseAbs() - Eigen::Vector3d::Constant(0.5 * kVoxel)).cwiseMax(0);
        truth = std::min(truth, outside.norm());
      }
      const DistanceBatch batch = QueryDistances(view, p, {.unknown_distances = true});
      ASSERT_NEAR(batch.unknown_distances_m[0], truth, 1e-5);
      const bool in_unknown = (batch.states[0] & kStateMask) == 0;
      EXPECT_EQ(in_unknown, batch.unknown_distances_m[0] == 0.f);
    }
  }
}

TEST(QueryValidation, NamesFieldIndexGotAndLimit) {
  MapView view = FloorView();
  view.stamp_ns = 77;
  testing::AddObject(view, 4, testing::CarShape(0.3), Pose::Identity());
  EXPECT_TRUE(ValidateQuery(view, 3, {}).ok());
  absl::Status status = ValidateQuery(view, 3, {.horizons_s = {0.f, 1.f}});
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("horizons has 2 values"));
  status = ValidateQuery(view, 2, {.horizons_s = {0.f, 6.f}});
  EXPECT_EQ(status.code(), absl::StatusCode::kOutOfRange);
  EXPECT_THAT(std::string(status.message()), HasSubstr("horizons[1] is 6"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("77"));
  EXPECT_EQ(ValidateQuery(view, 1, {.horizon_s = -0.1}).code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(ValidateQuery(view, 1, {.horizon_s = kNaN}).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(ValidateQuery(view, 1, {.max_distance_m = 2.1}).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(ValidateQuery(view, 1, {.sigma_margin = -1}).code(),
            absl::StatusCode::kInvalidArgument);
  status = ValidateQuery(view, 1, {.layers = {.without_objects = {ObjectId(4), ObjectId(5)}}});
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(status.message()), HasSubstr("without_objects[1]: no object 5"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("has: 4"));
  EXPECT_EQ(ValidateQuery(view, 1, {.layers = {.static_only = true, .only_objects = {ObjectId(4)}}})
                .code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace clearance
