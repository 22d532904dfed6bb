// Every malformed frame is acked as REJECTED with field and index; the stream lives, the map stays.
#include <cmath>
#include <functional>

#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;

struct BadFrame {
  const char* name;
  const char* field;
  int64_t index;
  std::function<void(v1::Frame*)> spoil;
};

void MakeDepth(v1::Frame* frame) {
  v1::DepthImage* depth = frame->mutable_depth();
  depth->set_width(4);
  depth->set_height(2);
  depth->set_fx(2);
  depth->set_fy(2);
  depth->set_cx(1.5);
  depth->set_cy(0.5);
  depth->set_depth_scale_m(0.001);
  depth->set_depth_u16(Bytes(std::vector<uint16_t>(8, 1000)));
}

v1::ObjectMotion* AddMotion(v1::Frame* frame, uint32_t id) {
  v1::ObjectMotion* motion = frame->add_motions();
  motion->set_object_id(id);
  motion->mutable_world_from_object()->set_qw(1);
  return motion;
}

const BadFrame kBadFrames[] = {
    {"not a number", "points_f32", 1,
     [](v1::Frame* f) {
       f->mutable_cloud()->set_points_f32(Bytes(std::vector<float>{0, 1, 2, 3, NAN, 5}));
     }},
    {"infinite", "points_f32", 0,
     [](v1::Frame* f) {
       f->mutable_cloud()->set_points_f32(Bytes(std::vector<float>{INFINITY, 1, 2}));
     }},
    {"length of points", "points_f32", -1,
     [](v1::Frame* f) { f->mutable_cloud()->set_points_f32(std::string(13, 'x')); }},
    {"length of labels", "labels_u16", -1,
     [](v1::Frame* f) { f->mutable_cloud()->set_labels_u16(std::string(6, 0)); }},
    {"odd bytes of labels", "labels_u16", -1,
     [](v1::Frame* f) { f->mutable_cloud()->set_labels_u16(std::string(1, 0)); }},
    {"rows times columns", "cloud", -1,
     [](v1::Frame* f) {
       f->mutable_cloud()->set_rows(2);
       f->mutable_cloud()->set_columns(3);
     }},
    {"zero quaternion", "world_from_sensor", -1,
     [](v1::Frame* f) { f->mutable_world_from_sensor()->set_qw(0); }},
    {"no pose", "world_from_sensor", -1, [](v1::Frame* f) { f->clear_world_from_sensor(); }},
    {"long quaternion", "world_from_sensor", -1,
     [](v1::Frame* f) { f->mutable_world_from_sensor()->set_qw(1.01); }},
    {"position not finite", "world_from_sensor", -1,
     [](v1::Frame* f) { f->mutable_world_from_sensor()->set_tx_m(NAN); }},
    {"depth of the wrong size", "depth_u16", -1,
     [](v1::Frame* f) {
       MakeDepth(f);
       f->mutable_depth()->set_width(5);
     }},
    {"depth without size", "depth", -1,
     [](v1::Frame* f) {
       MakeDepth(f);
       f->mutable_depth()->set_height(0);
     }},
    {"labels of another size", "labels_u16", -1,
     [](v1::Frame* f) {
       MakeDepth(f);
       f->mutable_depth()->set_labels_u16(std::string(4, 0));
     }},
    {"no focal length", "fx", -1,
     [](v1::Frame* f) {
       MakeDepth(f);
       f->mutable_depth()->set_fx(0);
     }},
    {"negative scale", "depth_scale_m", -1,
     [](v1::Frame* f) {
       MakeDepth(f);
       f->mutable_depth()->set_depth_scale_m(-0.001);
     }},
    {"object id 0", "object_id", -1, [](v1::Frame* f) { AddMotion(f, 0); }},
    {"object id too large, or negative", "object_id", -1,
     [](v1::Frame* f) { AddMotion(f, static_cast<uint32_t>(-1)); }},
    {"a motion of nothing", "motions", -1,
     [](v1::Frame* f) { f->add_motions()->set_object_id(3); }},
    {"a bad motion", "motions", -1,
     [](v1::Frame* f) { AddMotion(f, 3)->mutable_world_from_object()->set_qx(1); }},
    {"two motions of one object", "motions", -1,
     [](v1::Frame* f) {
       AddMotion(f, 3);
       AddMotion(f, 3);
     }},
    {"covariance of another size", "covariance_f64", -1,
     [](v1::Frame* f) { AddMotion(f, 3)->set_covariance_f64(std::string(8, 0)); }},
    {"a submap", "submap_id", -1, [](v1::Frame* f) { f->set_submap_id("a"); }},
};

class BadFramesTest : public ServiceFixture {};

TEST_F(BadFramesTest, AreRejectedWithFieldAndIndexAndNothingElseHappens) {
  StartServer();
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  uint64_t id = 1;
  ASSERT_TRUE(client.Send(ProtoFrame(id)));
  EXPECT_EQ(client.ReadAck().stamp().revision(), 1u);
  for (const BadFrame& bad : kBadFrames) {
    SCOPED_TRACE(bad.name);
    v1::Frame frame = ProtoFrame(++id);
    bad.spoil(&frame);
    ASSERT_TRUE(client.Send(frame));
    const v1::FrameAck ack = client.ReadAck();
    EXPECT_EQ(ack.frame_id(), id);
    EXPECT_EQ(ack.status(), v1::INGEST_STATUS_REJECTED);
    EXPECT_EQ(ack.stamp().revision(), 1u);
    ASSERT_GE(ack.violations_size(), 1);
    EXPECT_THAT(ack.violations(0).field(), HasSubstr(bad.field));
    if (bad.index >= 0) {
      EXPECT_EQ(ack.violations(0).index(), bad.index);
    }
    EXPECT_FALSE(ack.violations(0).description().empty());
  }
  EXPECT_EQ(Revision(), 1u);
  ASSERT_TRUE(client.Send(ProtoFrame(++id)));
  EXPECT_EQ(client.ReadAck().stamp().revision(), 2u);
  EXPECT_TRUE(client.Finish().ok());
}

TEST_F(BadFramesTest, IdsAndStampsThatGoBackAreRejected) {
  StartServer();
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  ASSERT_TRUE(client.Send(ProtoFrame(10)));
  EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_INTEGRATED);
  ASSERT_TRUE(client.Send(ProtoFrame(9)));
  v1::FrameAck ack = client.ReadAck();
  EXPECT_EQ(ack.status(), v1::INGEST_STATUS_REJECTED);
  EXPECT_EQ(ack.violations(0).field(), "frame.frame_id");
  v1::Frame late = ProtoFrame(11);
  late.set_stamp_ns(5);
  ASSERT_TRUE(client.Send(late));
  ack = client.ReadAck();
  EXPECT_EQ(ack.status(), v1::INGEST_STATUS_REJECTED);
  EXPECT_EQ(ack.violations(0).field(), "frame.stamp_ns");
  EXPECT_EQ(Revision(), 1u);
}

TEST_F(BadFramesTest, AMotionThatCannotBeUsedIsAViolationAndTheFrameCounts) {
  StartServer();
  v1::Frame frame = ProtoFrame(1);
  v1::ObjectMotion* motion = frame.add_motions();
  motion->set_object_id(3);
  motion->mutable_world_motion()->set_qw(1);
  const v1::FrameAck ack = Ingest(frame);
  EXPECT_EQ(ack.status(), v1::INGEST_STATUS_INTEGRATED);
  EXPECT_EQ(ack.violations_size(), 1);
  EXPECT_EQ(Revision(), 1u);
}

TEST_F(BadFramesTest, AMillionLabelledPointsPassAndMoreThanTheLimitAreRejected) {
  StartServer();
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  v1::Frame million = ProtoFrame(1, 1'000'000);
  million.mutable_cloud()->set_labels_u16(std::string(2'000'000, 0));
  ASSERT_TRUE(client.Send(million));
  EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_INTEGRATED);
  ASSERT_TRUE(client.Send(ProtoFrame(2, 1'100'001)));
  const v1::FrameAck ack = client.ReadAck();
  EXPECT_EQ(ack.status(), v1::INGEST_STATUS_REJECTED);
  EXPECT_THAT(ack.violations(0).description(), HasSubstr("1100000"));
  ASSERT_TRUE(client.Send(ProtoFrame(3)));
  EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_INTEGRATED);
  EXPECT_TRUE(client.Finish().ok());
}

TEST_F(BadFramesTest, NoPointsAtAllAreAFrame) {
  StartServer();
  EXPECT_EQ(Ingest(ProtoFrame(1, 0)).status(), v1::INGEST_STATUS_INTEGRATED);
  v1::Frame empty = ProtoFrame(2, 0);
  empty.mutable_cloud();
  EXPECT_EQ(Ingest(empty).status(), v1::INGEST_STATUS_INTEGRATED);
}

TEST_F(BadFramesTest, TheUnaryTwinAcksRejectionsAndDuplicatesToo) {
  StartServer();
  EXPECT_EQ(Ingest(ProtoFrame(1)).stamp().revision(), 1u);
  v1::Frame bad = ProtoFrame(2);
  bad.mutable_world_from_sensor()->set_qw(0);
  const v1::FrameAck ack = Ingest(bad);
  EXPECT_EQ(ack.status(), v1::INGEST_STATUS_REJECTED);
  EXPECT_THAT(ack.violations(0).field(), HasSubstr("world_from_sensor"));
  EXPECT_EQ(Ingest(ProtoFrame(1)).status(), v1::INGEST_STATUS_DUPLICATE);
  EXPECT_EQ(Revision(), 1u);
}

}  // namespace
}  // namespace clearance
