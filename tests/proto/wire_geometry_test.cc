#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "proto/wire/array.h"
#include "proto/wire/geometry.h"

namespace clearance::wire {
namespace {

using ::testing::HasSubstr;

Pose RandomPose(std::mt19937& rng, double span_m) {
  std::normal_distribution<double> normal;
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::Quaterniond(normal(rng), normal(rng), normal(rng), normal(rng))
                      .normalized()
                      .toRotationMatrix();
  pose.translation() = span_m * Eigen::Vector3d(normal(rng), normal(rng), normal(rng));
  return pose;
}

v1::Pose UnitPose() {
  v1::Pose pose;
  pose.set_qw(1);
  return pose;
}

TEST(WireGeometry, PosesSurviveBothWaysFarFromTheOrigin) {
  std::mt19937 rng(7);
  for (int i = 0; i < 200; ++i) {
    const Pose pose = RandomPose(rng, i % 2 == 0 ? 1.0 : 10'000.0);
    v1::Pose message;
    ToProto(pose, &message);
    const auto back = PoseFromProto(message, "pose");
    ASSERT_TRUE(back.ok()) << back.status();
    EXPECT_TRUE(back->translation() == pose.translation());
    EXPECT_LT((back->linear() - pose.linear()).norm(), 1e-14);
    std::string packed;
    AppendPose(pose, &packed);
    AppendPose(pose, &packed);
    const auto poses = DecodePoses(packed, "poses_f64");
    ASSERT_TRUE(poses.ok());
    ASSERT_EQ(poses->size(), 2u);
    EXPECT_TRUE((*poses)[1].matrix() == back->matrix());
  }
}

TEST(WireGeometry, RenormalisesAQuaternionThatIsSlightlyOffAndRefusesMore) {
  v1::Pose message = UnitPose();
  message.set_qw(1.0009);
  ASSERT_TRUE(PoseFromProto(message, "pose").ok());
  EXPECT_TRUE(PoseFromProto(message, "pose")->linear() == Eigen::Matrix3d::Identity());
  for (const double qw : {0.0, 0.99, 1.0011, 2.0}) {
    message.set_qw(qw);
    const auto pose = PoseFromProto(message, "frame.world_from_sensor");
    ASSERT_EQ(pose.status().code(), absl::StatusCode::kInvalidArgument) << qw;
    EXPECT_THAT(std::string(pose.status().message()),
                HasSubstr("frame.world_from_sensor: got a quaternion of norm"));
  }
}

TEST(WireGeometry, RefusesAPoseWithAnyValueThatIsNotFinite) {
  const auto* descriptor = v1::Pose::descriptor();
  for (const double bad :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (int i = 0; i < descriptor->field_count(); ++i) {
      v1::Pose message = UnitPose();
      message.GetReflection()->SetDouble(&message, descriptor->field(i), bad);
      const auto pose = PoseFromProto(message, "pose");
      EXPECT_EQ(pose.status().code(), absl::StatusCode::kInvalidArgument)
          << descriptor->field(i)->name();
    }
  }
}

TEST(WireGeometry, PackedPosesNameTheBadOne) {
  std::string packed;
  AppendPose(Pose::Identity(), &packed);
  packed += std::string(7 * sizeof(double), '\0');
  EXPECT_THAT(std::string(DecodePoses(packed, "poses_f64").status().message()),
              HasSubstr("poses_f64[1]: got a quaternion of norm 0"));
  packed.pop_back();
  EXPECT_THAT(std::string(DecodePoses(packed, "poses_f64").status().message()),
              HasSubstr("a multiple of 56 bytes"));
}

TEST(WireGeometry, BoxesAreOrderedAndSizesNotNegative) {
  v1::Box box;
  ToProto(Aabb(Eigen::Vector3d(-3, -2, -1), Eigen::Vector3d(1, 2, 3)), &box);
  ASSERT_TRUE(BoxFromProto(box, "bounds").ok());
  EXPECT_TRUE(BoxFromProto(box, "bounds")->min() == Eigen::Vector3d(-3, -2, -1));
  box.mutable_min()->set_y_m(2.5);
  EXPECT_THAT(std::string(BoxFromProto(box, "bounds").status().message()),
              HasSubstr("min <= max in every axis"));
  v1::OrientedBox oriented;
  ToProto(OrientedBox{Pose::Identity(), Eigen::Vector3d(1, 2, 3)}, &oriented);
  ASSERT_TRUE(BoxFromProto(oriented, "box").ok());
  oriented.mutable_size()->set_z_m(-1);
  EXPECT_THAT(std::string(BoxFromProto(oriented, "box").status().message()), HasSubstr("box.size"));
}

TEST(WireGeometry, PointsAndTwistsRoundTrip) {
  Eigen::Matrix3Xf points_f(3, 2);
  points_f << 1, -2, 3, 4, -5, 6;
  EXPECT_TRUE(*DecodePoints3f(EncodePoints(points_f), "p") == points_f);
  const Eigen::Matrix3Xd points_d = points_f.cast<double>() * 10'000.0 / 3.0;
  EXPECT_TRUE(*DecodePoints3d(EncodePoints(points_d), "p") == points_d);
  v1::Twist message;
  ToProto(Twist{Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(4, 5, 6)}, &message);
  const auto twist = TwistFromProto(message, "twist");
  ASSERT_TRUE(twist.ok());
  EXPECT_TRUE(twist->linear_mps == Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(twist->angular_radps == Eigen::Vector3d(4, 5, 6));
}

}  // namespace
}  // namespace clearance::wire
