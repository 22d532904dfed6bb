#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "proto/wire/array.h"
#include "proto/wire/check.h"
#include "proto/wire/geometry.h"

namespace clearance::wire {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

v1::CheckTrajectoriesRequest TwoPaths() {
  v1::CheckTrajectoriesRequest request;
  request.set_spheres_f32(EncodeArray<float>({0, 0, 0, 0.5f, 0.25f, -1, 2, 0.75f}));
  for (int i = 0; i < 2; ++i) {
    v1::Trajectory* path = request.add_trajectories();
    Pose pose = Pose::Identity();
    AppendPose(pose, path->mutable_waypoints_f64());
    pose.translation() << 10'000.125, -2, i;
    AppendPose(pose, path->mutable_waypoints_f64());
    path->set_times_f64(EncodeArray<double>({0.5, 1.5}));
  }
  return request;
}

TEST(WireCheck, ReadsEveryFieldOfACheck) {
  v1::CheckTrajectoriesRequest request = TwoPaths();
  request.set_map("yard-2");
  request.set_margin_m(0.1);
  request.set_sigma_margin(2);
  request.set_unknown_policy(v1::UNKNOWN_POLICY_AS_FREE);
  request.mutable_layers()->add_without_objects(9);
  request.mutable_consistency()->set_pin_id(4);
  request.set_reference_ns(77);
  const auto query = TrajectoriesQueryFromProto(request);
  ASSERT_TRUE(query.ok()) << query.status();
  EXPECT_EQ(query->check.settings.map, "yard-2");
  EXPECT_EQ(query->check.settings.time.reference_ns, 77);
  EXPECT_EQ(query->check.settings.consistency.pin_id, 4u);
  EXPECT_THAT(query->check.settings.layers.without_objects, ElementsAre(ObjectId(9)));
  EXPECT_EQ(query->check.margin_m, 0.1);
  EXPECT_EQ(query->check.settings.sigma_margin, 2);
  EXPECT_TRUE(query->check.unknown_as_free);
  ASSERT_EQ(query->check.spheres.size(), 2u);
  EXPECT_EQ(query->check.spheres[1].centre_R, Eigen::Vector3d(0.25, -1, 2));
  EXPECT_EQ(query->check.spheres[1].radius_m, 0.75);
  ASSERT_EQ(query->trajectories.size(), 2u);
  EXPECT_EQ(query->trajectories[1].T_W_R[1].translation(), Eigen::Vector3d(10'000.125, -2, 1));
  EXPECT_THAT(query->trajectories[1].times_s, ElementsAre(0.5, 1.5));
}

TEST(WireCheck, UnknownSpaceBlocksWhereNothingIsSaid) {
  EXPECT_FALSE(TrajectoriesQueryFromProto(TwoPaths())->check.unknown_as_free);
}

TEST(WireCheck, LimitsCountAllTrajectoriesTogether) {
  CheckLimits limits;
  limits.max_waypoints = 3;
  const auto query = TrajectoriesQueryFromProto(TwoPaths(), limits);
  EXPECT_EQ(query.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(query.status().message()), HasSubstr("trajectories[1].waypoints_f64"));
  limits.max_waypoints = 4;
  EXPECT_TRUE(TrajectoriesQueryFromProto(TwoPaths(), limits).ok());
  limits.max_states = 7;
  EXPECT_EQ(TrajectoriesQueryFromProto(TwoPaths(), limits).status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST(WireCheck, ReadsRegionsAndPins) {
  v1::GetRegionRequest request;
  EXPECT_THAT(std::string(RegionQueryFromProto(request).status().message()), HasSubstr("bounds"));
  ToProto(Aabb(Eigen::Vector3d(-1, -2, -3), Eigen::Vector3d(1, 2, 3)), request.mutable_bounds());
  request.set_resolution_m(0.25);
  request.set_known_only(true);
  request.set_horizon_s(2);
  const auto region = RegionQueryFromProto(request);
  ASSERT_TRUE(region.ok()) << region.status();
  EXPECT_EQ(region->bounds.max(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(region->resolution_m, 0.25);
  EXPECT_TRUE(region->known_only);
  EXPECT_FALSE(region->gradients);
  EXPECT_EQ(region->settings.time.horizon_s, 2);
  v1::PinRevisionRequest pin;
  pin.set_revision(5);
  pin.set_ttl_s(1.5);
  EXPECT_EQ(PinQueryFromProto(pin)->revision, 5u);
  EXPECT_EQ(PinQueryFromProto(pin)->ttl_s, 1.5);
  EXPECT_EQ(PinQueryFromProto(pin)->settings.map, "default");
}

}  // namespace
}  // namespace clearance::wire
