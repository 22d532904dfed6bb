#include "server/core/frame.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace clearance {
namespace {

using ::testing::HasSubstr;

Frame CloudFrame() {
  Frame frame;
  PointCloud cloud;
  cloud.points_X = Eigen::Matrix3Xf::Random(3, 10);
  cloud.labels.assign(10, 0);
  frame.observation = cloud;
  return frame;
}

Frame DepthFrame() {
  Frame frame;
  DepthImage image;
  image.width = 4, image.height = 3;
  image.fx = 2, image.fy = 2, image.cx = 1.5, image.cy = 1;
  image.depth_scale_m = 0.001;
  image.depth.assign(12, 1000);
  frame.observation = image;
  return frame;
}

ObjectMotion MotionOf(uint16_t id) {
  ObjectMotion motion;
  motion.object_id = ObjectId(id);
  return motion;
}

void ExpectRefused(const Frame& frame, const std::string& words) {
  const absl::Status status = ValidateFrame(frame);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << words;
  EXPECT_THAT(std::string(status.message()), HasSubstr(words));
}

TEST(Frame, AcceptsCloudsImagesAndFramesWithoutPoints) {
  EXPECT_TRUE(ValidateFrame(CloudFrame()).ok());
  EXPECT_TRUE(ValidateFrame(DepthFrame()).ok());
  EXPECT_TRUE(ValidateFrame(Frame{}).ok());
}

TEST(Frame, NamesTheFirstPointThatIsNotFinite) {
  for (float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    Frame frame = CloudFrame();
    std::get<PointCloud>(frame.observation).points_X(1, 7) = bad;
    ExpectRefused(frame, "cloud.points[7]");
  }
}

TEST(Frame, RefusesLabelsOfAnotherLength) {
  Frame frame = CloudFrame();
  std::get<PointCloud>(frame.observation).labels.pop_back();
  ExpectRefused(frame, "cloud.labels has 9 labels for 10 elements");
  frame = DepthFrame();
  std::get<DepthImage>(frame.observation).labels.assign(11, 0);
  ExpectRefused(frame, "depth.labels has 11 labels for 12 elements");
}

TEST(Frame, RefusesOrganisedSizesThatDoNotMatch) {
  Frame frame = CloudFrame();
  std::get<PointCloud>(frame.observation).columns = 5;
  std::get<PointCloud>(frame.observation).rows = 3;
  ExpectRefused(frame, "columns x rows = 5 x 3");
}

TEST(Frame, RefusesADepthImageOfTheWrongSizeOrWithoutOptics) {
  Frame frame = DepthFrame();
  std::get<DepthImage>(frame.observation).depth.pop_back();
  ExpectRefused(frame, "depth.depth has 11 values; expected width x height = 12");
  frame = DepthFrame();
  std::get<DepthImage>(frame.observation).fx = 0;
  ExpectRefused(frame, "focal lengths");
  frame = DepthFrame();
  std::get<DepthImage>(frame.observation).depth_scale_m = -1;
  ExpectRefused(frame, "depth_scale_m");
}

TEST(Frame, RefusesPosesThatAreNotRigidOrTooFarAway) {
  Frame frame = CloudFrame();
  frame.T_W_X.linear() *= 1.01;
  ExpectRefused(frame, "world_from_sensor is not a rigid pose");
  frame = CloudFrame();
  frame.T_W_X.translation().x() = 2e7;
  ExpectRefused(frame, "limited to 1e+07 m");
  frame = CloudFrame();
  frame.T_W_X.translation().x() = NAN;
  ExpectRefused(frame, "not finite");
}

TEST(Frame, RefusesMotionsOfTheStaticWorldAndTwoForOneObject) {
  Frame frame = CloudFrame();
  frame.motions = {MotionOf(0)};
  ExpectRefused(frame, "motions[0].object_id is 0");
  frame.motions = {MotionOf(4), MotionOf(4)};
  ExpectRefused(frame, "motions[1].object_id 4 occurs twice");
}

TEST(Frame, StatesTheLimitOfPoints) {
  Frame frame = CloudFrame();
  const absl::Status status = ValidateFrame(frame, {.max_points = 9, .max_motions = 1});
  EXPECT_THAT(std::string(status.message()), HasSubstr("has 10 points; limit 9"));
}

}  // namespace
}  // namespace clearance
