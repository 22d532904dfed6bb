#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "proto/wire/array.h"
#include "proto/wire/ids.h"
#include "proto/wire/query.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kInf = std::numeric_limits<double>::infinity();

v1::QueryPointsRequest TwoPoints() {
  v1::QueryPointsRequest request;
  request.set_positions_f64(EncodeArray<double>({10'000.125, -2, 0.5, 1, 2, 3}));
  return request;
}

TEST(WireQuery, ReadsEveryFieldOfAQuery) {
  v1::QueryPointsRequest request = TwoPoints();
  request.set_map("yard-2");
  request.set_horizon_s(1.5);
  request.set_reference_ns(77);
  request.set_gradients(true);
  request.set_objects(true);
  request.set_sigmas(true);
  request.set_unknown_distances(true);
  request.set_fusion(v1::FUSION_WEIGHTED);
  request.mutable_layers()->add_only_objects(9);
  request.mutable_layers()->add_only_objects(3);
  request.mutable_layers()->add_only_objects(9);
  request.set_max_distance_m(2);
  request.set_sigma_margin(2.5);
  request.mutable_consistency()->set_min_revision(4);
  request.mutable_consistency()->set_wait_s(0.5);
  const auto query = PointsQueryFromProto(request);
  ASSERT_TRUE(query.ok()) << query.status();
  EXPECT_EQ(query->settings.map, "yard-2");
  EXPECT_EQ(query->settings.time.horizon_s, 1.5);
  EXPECT_EQ(query->settings.time.reference_ns, 77);
  EXPECT_FALSE(query->settings.time.at_ns.has_value());
  EXPECT_TRUE(query->gradients && query->objects && query->sigmas && query->unknown_distances);
  EXPECT_TRUE(query->settings.weighted_fusion);
  EXPECT_THAT(query->settings.layers.only_objects, ElementsAre(ObjectId(3), ObjectId(9)));
  EXPECT_EQ(query->settings.max_distance_m, 2);
  EXPECT_EQ(query->settings.sigma_margin, 2.5);
  EXPECT_EQ(query->settings.consistency.min_revision, 4u);
  EXPECT_EQ(query->points_W(0, 0), 10'000.125);
}

TEST(WireQuery, TheMapIsCalledDefaultAndTheTimeIsTheMapsWhereNothingIsSaid) {
  const auto query = PointsQueryFromProto(TwoPoints());
  ASSERT_TRUE(query.ok());
  EXPECT_EQ(query->settings.map, "default");
  EXPECT_FALSE(query->settings.time.at_ns.has_value());
  EXPECT_FALSE(query->settings.time.reference_ns.has_value());
  EXPECT_EQ(query->settings.time.horizon_s, 0);
  EXPECT_FALSE(query->settings.weighted_fusion);
}

TEST(WireQuery, AllPositionFieldsGiveTheSamePoints) {
  v1::QueryPointsRequest f32, xyz;
  f32.set_positions_f32(EncodeArray<float>({1, -2, 0.5f}));
  for (const double v : {1.0, -2.0, 0.5}) xyz.add_positions_xyz(v);
  const Eigen::Vector3d expected(1, -2, 0.5);
  EXPECT_TRUE(PointsQueryFromProto(f32)->points_W.col(0) == expected);
  EXPECT_TRUE(PointsQueryFromProto(xyz)->points_W.col(0) == expected);
}

TEST(WireQuery, TheBatchLimitHolds) {
  v1::QueryPointsRequest request;
  request.set_positions_f32(std::string(12 * 100'000, '\0'));
  EXPECT_TRUE(PointsQueryFromProto(request).ok());
  request.set_positions_f32(std::string(12 * 100'001, '\0'));
  EXPECT_THAT(std::string(PointsQueryFromProto(request).status().message()),
              HasSubstr("got 100001 points; expected at most 100000 a call"));
}

struct BadQuery {
  const char* name;
  std::function<void(v1::QueryPointsRequest&)> spoil;
  const char* field;
  int64_t index;
};

class WireBadQuery : public ::testing::TestWithParam<BadQuery> {};

TEST_P(WireBadQuery, IsRefusedNamingFieldAndIndex) {
  v1::QueryPointsRequest request = TwoPoints();
  GetParam().spoil(request);
  const auto query = PointsQueryFromProto(request);
  ASSERT_EQ(query.status().code(), absl::StatusCode::kInvalidArgument);
  const auto violations = ViolationsOf(query.status());
  ASSERT_EQ(violations.size(), 1u);
  EXPECT_EQ(violations[0].field, GetParam().field);
  EXPECT_EQ(violations[0].index, GetParam().index);
}

INSTANTIATE_TEST_SUITE_P(
    AllBadInputs, WireBadQuery,
    ::testing::Values(
        BadQuery{"MapName", [](auto& r) { r.set_map("Yard"); }, "map", -1},
        BadQuery{"MapNameLong", [](auto& r) { r.set_map(std::string(64, 'a')); }, "map", -1},
        BadQuery{"Empty", [](auto& r) { r.clear_positions_f64(); }, "positions_f32", -1},
        BadQuery{"TwoFields", [](auto& r) { r.set_positions_f32(std::string(12, '\0')); },
                 "positions_f32", -1},
        BadQuery{"Length", [](auto& r) { r.mutable_positions_f64()->pop_back(); }, "positions_f64",
                 -1},
        BadQuery{"Nan",
                 [](auto& r) {
                   r.set_positions_f64(EncodeArray<double>({0, 0, 0, 0, std::nan(""), 0}));
                 },
                 "positions_f64", 1},
        BadQuery{"XyzCount",
                 [](auto& r) {
                   r.clear_positions_f64();
                   r.add_positions_xyz(1);
                 },
                 "positions_xyz", -1},
        BadQuery{"XyzTooMany",
                 [](auto& r) {
                   r.clear_positions_f64();
                   for (int i = 0; i < 65 * 3; ++i) r.add_positions_xyz(1);
                 },
                 "positions_xyz", -1},
        BadQuery{"XyzInfinite",
                 [](auto& r) {
                   r.clear_positions_f64();
                   for (int i = 0; i < 6; ++i) r.add_positions_xyz(i == 5 ? kInf : 0);
                 },
                 "positions_xyz", 1},
        BadQuery{"Horizon", [](auto& r) { r.set_horizon_s(kInf); }, "horizon_s", -1},
        BadQuery{"HorizonsCount", [](auto& r) { r.set_horizons_f32(std::string(12, '\0')); },
                 "horizons_f32", -1},
        BadQuery{"HorizonsLength", [](auto& r) { r.set_horizons_f32(std::string(7, '\0')); },
                 "horizons_f32", -1},
        BadQuery{"HorizonsNan",
                 [](auto& r) {
                   r.set_horizons_f32(EncodeArray<float>({0, std::nanf("")}));
                 },
                 "horizons_f32", 1},
        BadQuery{"HorizonsAndTime",
                 [](auto& r) {
                   r.set_horizons_f32(std::string(8, '\0'));
                   r.set_at_ns(5);
                 },
                 "horizons_f32", -1},
        BadQuery{"Fusion", [](auto& r) { r.set_fusion(static_cast<v1::Fusion>(9)); }, "fusion", -1},
        BadQuery{"LayerId", [](auto& r) { r.mutable_layers()->add_without_objects(0); },
                 "layers.without_objects", 0},
        BadQuery{"LayersExclude",
                 [](auto& r) {
                   r.mutable_layers()->set_static_only(true);
                   r.mutable_layers()->add_only_objects(1);
                 },
                 "layers", -1},
        BadQuery{"MaxDistance", [](auto& r) { r.set_max_distance_m(-1); }, "max_distance_m", -1},
        BadQuery{"SigmaMargin", [](auto& r) { r.set_sigma_margin(std::nan("")); }, "sigma_margin",
                 -1},
        BadQuery{"WaitNegative", [](auto& r) { r.mutable_consistency()->set_wait_s(-1); },
                 "consistency.wait_s", -1},
        BadQuery{"WaitLong", [](auto& r) { r.mutable_consistency()->set_wait_s(61); },
                 "consistency.wait_s", -1}),
    [](const auto& info) { return info.param.name; });

TEST(WireQuery, SlicesCheckTheirHeightBoundsAndResolution) {
  v1::GetSliceRequest request;
  request.set_z_m(0.5);
  request.set_resolution_m(0.1);
  ASSERT_TRUE(SliceQueryFromProto(request).ok());
  EXPECT_EQ(SliceQueryFromProto(request)->z_m, 0.5);
  request.set_resolution_m(-0.1);
  EXPECT_THAT(std::string(SliceQueryFromProto(request).status().message()),
              HasSubstr("resolution_m"));
  request.set_resolution_m(0);
  request.set_z_m(kInf);
  EXPECT_THAT(std::string(SliceQueryFromProto(request).status().message()), HasSubstr("z_m"));
  request.set_z_m(0);
  request.mutable_bounds()->mutable_min()->set_x_m(2);
  EXPECT_THAT(std::string(SliceQueryFromProto(request).status().message()), HasSubstr("bounds"));
}

TEST(WireQuery, ListsObjectsAtATime) {
  v1::ListObjectsRequest request;
  request.set_at_ns(-5);
  request.set_include_history(true);
  const auto query = ObjectsQueryFromProto(request);
  ASSERT_TRUE(query.ok());
  EXPECT_EQ(query->settings.time.at_ns, -5);
  EXPECT_TRUE(query->include_history);
}

TEST(WireQuery, NamesAreLowerCaseAndShort) {
  for (const char* good : {"a", "kitti_0005", "yard-2", "a0"}) {
    EXPECT_EQ(*NameFromProto(good, "map"), good);
  }
  EXPECT_EQ(*NameFromProto("", "map"), "default");
  for (const char* bad : {"0a", "-a", "_a", "A", "a b", "a/b", "..", "\xff"}) {
    EXPECT_EQ(NameFromProto(bad, "map").status().code(), absl::StatusCode::kInvalidArgument) << bad;
  }
  EXPECT_TRUE(NameFromProto(std::string(63, 'a'), "map").ok());
}

}  // namespace
}  // namespace clearance::wire
