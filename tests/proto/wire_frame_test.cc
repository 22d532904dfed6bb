#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "proto/wire/array.h"
#include "proto/wire/frame.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

using ::testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

v1::Frame CloudFrame() {
  v1::Frame frame;
  frame.set_frame_id(3);
  frame.set_stamp_ns(1'317'042'272'349'000'000);
  frame.mutable_world_from_sensor()->set_qw(1);
  frame.mutable_cloud()->set_points_f32(
      EncodeArray<float>({1, 2, 3, -4, -5, -6, 7, 8, 9, 0, 0, 0}));
  frame.mutable_cloud()->set_labels_u16(EncodeArray<uint16_t>({0, 1, 65535, 0}));
  auto* motion = frame.add_motions();
  motion->set_object_id(1);
  motion->mutable_world_motion()->set_qw(1);
  return frame;
}

v1::Frame DepthFrame() {
  v1::Frame frame = CloudFrame();
  auto* depth = frame.mutable_depth();  // replaces the cloud
  depth->set_width(3);
  depth->set_height(2);
  depth->set_fx(500);
  depth->set_fy(501);
  depth->set_cx(1);
  depth->set_cy(-0.5);
  depth->set_depth_scale_m(0.001);
  depth->set_depth_u16(EncodeArray<uint16_t>({0, 1, 2, 3, 4, 65535}));
  depth->set_labels_u16(EncodeArray<uint16_t>({0, 0, 7, 7, 0, 0}));
  return frame;
}

TEST(WireFrame, ACloudSurvivesBothWays) {
  v1::Frame message = CloudFrame();
  message.mutable_cloud()->set_columns(2);
  message.mutable_cloud()->set_rows(2);
  message.mutable_motions(0)->set_from_frame_id(1);
  message.mutable_motions(0)->set_class_name("Van");
  message.mutable_motions(0)->set_covariance_f64(EncodeArray(std::vector<double>(36, 0.25)));
  const auto frame = FrameFromProto(message);
  ASSERT_TRUE(frame.ok()) << frame.status();
  const auto& cloud = std::get<PointCloud>(frame->observation);
  EXPECT_TRUE(cloud.points_X.col(1) == Eigen::Vector3f(-4, -5, -6));
  EXPECT_EQ(cloud.labels, (std::vector<uint16_t>{0, 1, 65535, 0}));
  EXPECT_EQ(frame->motions[0].from_frame_id, 1u);
  v1::Frame back;
  ToProto(*frame, &back);
  EXPECT_EQ(back.SerializeAsString(), message.SerializeAsString());
}

TEST(WireFrame, ADepthImageSurvivesBothWays) {
  v1::Frame message = DepthFrame();
  message.mutable_motions(0)->mutable_world_from_object()->set_qw(1);
  const auto frame = FrameFromProto(message);
  ASSERT_TRUE(frame.ok()) << frame.status();
  EXPECT_EQ(frame->motions[0].kind, ObjectMotion::Kind::kWorldFromObject);
  EXPECT_EQ(std::get<DepthImage>(frame->observation).depth[5], 65535);
  v1::Frame back;
  ToProto(*frame, &back);
  EXPECT_EQ(back.SerializeAsString(), message.SerializeAsString());
}

TEST(WireFrame, AFrameWithoutPointsIsValid) {
  v1::Frame message = CloudFrame();
  message.clear_observation();
  ASSERT_TRUE(FrameFromProto(message).ok());
  message.mutable_cloud();
  ASSERT_TRUE(FrameFromProto(message).ok());
}

TEST(WireFrame, AMillionPointsPassAndTheLimitHolds) {
  v1::Frame message = CloudFrame();
  message.mutable_cloud()->set_points_f32(std::string(12'000'000, '\0'));
  message.mutable_cloud()->clear_labels_u16();
  EXPECT_TRUE(FrameFromProto(message).ok());
  const auto frame = FrameFromProto(message, FrameLimits{.max_points = 999'999});
  EXPECT_THAT(std::string(frame.status().message()),
              HasSubstr("frame.cloud.points_f32: got 1000000 points; expected at most 999999"));
}

struct BadFrame {
  const char* name;
  v1::Frame (*make)();
  std::function<void(v1::Frame&)> spoil;
  const char* field;
  int64_t index;
};

class WireBadFrame : public ::testing::TestWithParam<BadFrame> {};

TEST_P(WireBadFrame, IsRefusedNamingFieldAndIndex) {
  v1::Frame message = GetParam().make();
  ASSERT_TRUE(FrameFromProto(message).ok());
  GetParam().spoil(message);
  const auto frame = FrameFromProto(message);
  ASSERT_EQ(frame.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(frame.status().message()), HasSubstr("; expected "));
  const auto violations = ViolationsOf(frame.status());
  ASSERT_EQ(violations.size(), 1u);
  EXPECT_EQ(violations[0].field, GetParam().field);
  EXPECT_EQ(violations[0].index, GetParam().index);
}

void Motion(v1::Frame& f, const std::function<void(v1::ObjectMotion&)>& spoil) {
  spoil(*f.mutable_motions(0));
}

INSTANTIATE_TEST_SUITE_P(
    AllBadInputs, WireBadFrame,
    ::testing::Values(
        BadFrame{"SubmapId", CloudFrame, [](auto& f) { f.set_submap_id("a"); }, "frame.submap_id",
                 -1},
        BadFrame{"NoPose", CloudFrame, [](auto& f) { f.clear_world_from_sensor(); },
                 "frame.world_from_sensor", -1},
        BadFrame{"ZeroQuaternion", CloudFrame,
                 [](auto& f) { f.mutable_world_from_sensor()->set_qw(0); },
                 "frame.world_from_sensor", -1},
        BadFrame{"PosePositionNan", CloudFrame,
                 [](auto& f) { f.mutable_world_from_sensor()->set_ty_m(std::nan("")); },
                 "frame.world_from_sensor", -1},
        BadFrame{"PointsLength", CloudFrame,
                 [](auto& f) { f.mutable_cloud()->mutable_points_f32()->pop_back(); },
                 "frame.cloud.points_f32", -1},
        BadFrame{"PointNan", CloudFrame,
                 [](auto& f) {
                   f.mutable_cloud()->set_points_f32(
                       EncodeArray<float>({1, 2, 3, 4, 5, 6, 7, kNan, 9, 0, 0, 0}));
                 },
                 "frame.cloud.points_f32", 2},
        BadFrame{"LabelsCount", CloudFrame,
                 [](auto& f) { f.mutable_cloud()->set_labels_u16(std::string(6, '\0')); },
                 "frame.cloud.labels_u16", -1},
        BadFrame{"LabelsLength", CloudFrame,
                 [](auto& f) { f.mutable_cloud()->set_labels_u16(std::string(7, '\0')); },
                 "frame.cloud.labels_u16", -1},
        BadFrame{"Organisation", CloudFrame, [](auto& f) { f.mutable_cloud()->set_columns(3); },
                 "frame.cloud.columns", -1},
        BadFrame{"OrganisationOverflow", CloudFrame,
                 [](auto& f) {
                   f.mutable_cloud()->set_columns(1u << 31);
                   f.mutable_cloud()->set_rows(1u << 31);
                 },
                 "frame.cloud.columns", -1},
        BadFrame{"DepthWidthZero", DepthFrame, [](auto& f) { f.mutable_depth()->set_width(0); },
                 "frame.depth.width", -1},
        BadFrame{"DepthHeightZero", DepthFrame, [](auto& f) { f.mutable_depth()->set_height(0); },
                 "frame.depth.height", -1},
        BadFrame{"DepthSize", DepthFrame, [](auto& f) { f.mutable_depth()->set_height(3); },
                 "frame.depth.depth_u16", -1},
        BadFrame{"DepthHuge", DepthFrame,
                 [](auto& f) {
                   f.mutable_depth()->set_width(0xffffffff);
                   f.mutable_depth()->set_height(0xffffffff);
                 },
                 "frame.depth.width", -1},
        BadFrame{"DepthLabels", DepthFrame,
                 [](auto& f) { f.mutable_depth()->set_labels_u16(std::string(10, '\0')); },
                 "frame.depth.labels_u16", -1},
        BadFrame{"FxZero", DepthFrame, [](auto& f) { f.mutable_depth()->set_fx(0); },
                 "frame.depth.fx", -1},
        BadFrame{"FyNegative", DepthFrame, [](auto& f) { f.mutable_depth()->set_fy(-1); },
                 "frame.depth.fy", -1},
        BadFrame{"CxInfinite", DepthFrame, [](auto& f) { f.mutable_depth()->set_cx(kInf); },
                 "frame.depth.cx", -1},
        BadFrame{"CyNan", DepthFrame, [](auto& f) { f.mutable_depth()->set_cy(std::nan("")); },
                 "frame.depth.cy", -1},
        BadFrame{"DepthScale", DepthFrame,
                 [](auto& f) { f.mutable_depth()->set_depth_scale_m(-0.001); },
                 "frame.depth.depth_scale_m", -1},
        BadFrame{"ObjectIdZero", CloudFrame,
                 [](auto& f) { Motion(f, [](auto& m) { m.set_object_id(0); }); },
                 "frame.motions[0].object_id", 0},
        BadFrame{"ObjectIdTooLarge", CloudFrame,
                 [](auto& f) { Motion(f, [](auto& m) { m.set_object_id(65536); }); },
                 "frame.motions[0].object_id", 0},
        // A negative id in the client's language arrives as this.
        BadFrame{"ObjectIdNegative", CloudFrame,
                 [](auto& f) {
                   Motion(f, [](auto& m) { m.set_object_id(static_cast<uint32_t>(-1)); });
                 },
                 "frame.motions[0].object_id", 0},
        BadFrame{"NoMotion", CloudFrame,
                 [](auto& f) { Motion(f, [](auto& m) { m.clear_motion(); }); },
                 "frame.motions[0].motion", 0},
        BadFrame{"MotionQuaternion", CloudFrame,
                 [](auto& f) {
                   Motion(f, [](auto& m) { m.mutable_world_motion()->set_qz(1); });
                 },
                 "frame.motions[0].world_motion", 0},
        BadFrame{"TwoMotions", CloudFrame, [](auto& f) { *f.add_motions() = f.motions(0); },
                 "frame.motions[1].object_id", 1},
        BadFrame{"CovarianceLength", CloudFrame,
                 [](auto& f) {
                   Motion(f, [](auto& m) { m.set_covariance_f64(std::string(280, '\0')); });
                 },
                 "frame.motions[0].covariance_f64", 0},
        BadFrame{"TwoCovariances", CloudFrame,
                 [](auto& f) {
                   Motion(f, [](auto& m) { m.set_covariance_f64(std::string(576, '\0')); });
                 },
                 "frame.motions[0].covariance_f64", 0},
        BadFrame{"NegativeVariance", CloudFrame,
                 [](auto& f) {
                   Motion(f, [](auto& m) {
                     m.set_covariance_f64(EncodeArray(std::vector<double>(36, -1.0)));
                   });
                 },
                 "frame.motions[0].covariance_f64", 0},
        BadFrame{"ClassName", CloudFrame,
                 [](auto& f) {
                   Motion(f, [](auto& m) { m.set_class_name(std::string(65, 'a')); });
                 },
                 "frame.motions[0].class_name", 0}),
    [](const auto& info) { return info.param.name; });

TEST(WireFrame, TooManyMotionsAreRefused) {
  v1::Frame message = CloudFrame();
  for (uint32_t id = 2; id <= 5; ++id) {
    *message.add_motions() = message.motions(0);
    message.mutable_motions(static_cast<int>(id) - 1)->set_object_id(id);
  }
  FrameLimits limits;
  limits.max_motions = 5;
  EXPECT_TRUE(FrameFromProto(message, limits).ok());
  limits.max_motions = 4;
  EXPECT_THAT(std::string(FrameFromProto(message, limits).status().message()),
              HasSubstr("frame.motions: got 5; expected at most 4"));
}

TEST(WireFrame, ARangeLimitIsFiniteAndNotNegative) {
  EXPECT_EQ(*MaxRangeFromProto(25.0, "open.max_range_m"), 25.0);
  EXPECT_EQ(*MaxRangeFromProto(0.0, "open.max_range_m"), 0.0);
  for (const double bad : {-1.0, kInf, std::nan("")}) {
    EXPECT_THAT(std::string(MaxRangeFromProto(bad, "open.max_range_m").status().message()),
                HasSubstr("open.max_range_m"));
  }
}

}  // namespace
}  // namespace clearance::wire
