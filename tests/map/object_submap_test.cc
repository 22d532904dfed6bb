#include "server/map/object_submap.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "server/map/world_map.h"

namespace clearance {
namespace {

constexpr int64_t kPeriod_ns = 100'000'000;

SurfaceUpdate SomeSurface() {
  SurfaceUpdate update;
  update.band.blocks.push_back({BlockIndex{-1, 0, 0}, 0, 300});
  for (int i = 0; i < 300; ++i) {
    update.band.offset.push_back(i);
    update.band.distance_m.push_back(0.001f * (i - 150));
    update.band.weight.push_back(0.7f);
  }
  return update;
}

MapUpdate FrameAt(uint64_t k) {
  MapUpdate frame;
  frame.source_id = "car";
  frame.frame_id = k;
  frame.stamp_ns = int64_t(k) * kPeriod_ns;
  return frame;
}

ObjectUpdate Created(uint16_t id, const Pose& T_W_L) {
  ObjectUpdate u;
  u.id = ObjectId(id);
  u.event = ObjectEvent::kCreated;
  u.T_W_L = T_W_L;
  u.observed = true;
  u.surface = SomeSurface();
  return u;
}

ObjectUpdate Moved(const ObjectSubmap& object, const Pose& H_W, bool observed) {
  ObjectUpdate u;
  u.id = object.id();
  u.event = ObjectEvent::kMoved;
  u.T_W_L = Orthonormalized(H_W * object.T_W_L());
  u.H_W = H_W;
  u.motion_period_s = kPeriod_ns * 1e-9;
  u.observed = observed;
  return u;
}

TEST(ObjectSubmap, KeepsItsVoxelsBitForBitWhenTheObjectMoves) {
  WorldMap map(MapConfig{});
  MapUpdate frame = FrameAt(1);
  frame.objects.push_back(Created(7, Pose(Eigen::Translation3d(3, -2, 1))));
  map.Apply(frame);
  const ObjectSubmap& object = map.objects().at(ObjectId(7));
  const BlockIndex block{-1, 0, 0};
  const std::vector<float> mean(object.surface().MeanBlock(block),
                                object.surface().MeanBlock(block) + kBlockVoxels);
  const std::vector<float> weight(object.surface().WeightBlock(block),
                                  object.surface().WeightBlock(block) + kBlockVoxels);
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> u(-1, 1);
  for (uint64_t k = 2; k < 50; ++k) {
    Screw xi;
    for (int i = 0; i < 6; ++i) xi[i] = u(rng);
    frame = FrameAt(k);
    frame.objects.push_back(Moved(object, ExpScrew(xi), false));
    const AppliedChanges changes = map.Apply(frame);
    EXPECT_TRUE(changes.objects.at(0).blocks.empty());
  }
  EXPECT_TRUE(std::equal(mean.begin(), mean.end(), object.surface().MeanBlock(block)));
  EXPECT_TRUE(std::equal(weight.begin(), weight.end(), object.surface().WeightBlock(block)));
}

TEST(ObjectSubmap, ChainOfTwoHundredMotionsKeepsThePoseWithinAMillimetre) {
  // Truth: a screw about a far axis, evaluated directly at every frame; 10 km from the origin.
  const Eigen::Vector3d centre(10'000, -20'000, 30);
  Pose start = Pose::Identity();
  start.translation() = centre + Eigen::Vector3d(15, 0, 0);
  const auto truth = [&](int k) {
    Pose T = Pose::Identity();
    const Eigen::AngleAxisd turn(0.03 * k, Eigen::Vector3d(0.1, -0.2, 1).normalized());
    T.linear() = turn.toRotationMatrix();
    T.translation() =
        centre + turn * (start.translation() - centre) + Eigen::Vector3d(0, 0, 0.05 * k);
    return T;
  };
  WorldMap map(MapConfig{});
  MapUpdate frame = FrameAt(0);
  frame.objects.push_back(Created(1, truth(0)));
  map.Apply(frame);
  const ObjectSubmap& object = map.objects().at(ObjectId(1));
  for (int k = 1; k <= 200; ++k) {
    frame = FrameAt(k);
    frame.objects.push_back(Moved(object, truth(k) * truth(k - 1).inverse(), true));
    map.Apply(frame);
  }
  const Pose off = truth(200).inverse() * object.T_W_L();
  EXPECT_LT(off.translation().norm(), 1e-3);
  EXPECT_LT(Eigen::AngleAxisd(off.linear()).angle(), 1e-6);
  // One second ahead along the smoothed screw.
  EXPECT_LT((truth(210).translation() - object.CoastedTo(210 * kPeriod_ns).translation()).norm(),
            0.05);
}

TEST(ObjectSubmap, LivesByFrameStampsFromTrackedToRetired) {
  WorldMap map(MapConfig{});
  MapUpdate frame = FrameAt(0);
  frame.objects.push_back(Created(5, Pose::Identity()));
  map.Apply(frame);
  const auto state = [&] { return map.objects().at(ObjectId(5)).life_state(); };
  EXPECT_EQ(state(), LifeState::kTracked);
  const auto coast = [&](double t_s) {
    MapUpdate f = FrameAt(static_cast<uint64_t>(std::lround(t_s * 10)));
    ObjectUpdate u;
    u.id = ObjectId(5);
    u.event = ObjectEvent::kCoasted;
    u.T_W_L = map.objects().at(ObjectId(5)).CoastedTo(f.stamp_ns);
    f.objects.push_back(u);
    map.Apply(f);
  };
  coast(0.1);
  EXPECT_EQ(state(), LifeState::kCoasting);
  coast(2.5);
  EXPECT_EQ(state(), LifeState::kLost);
  coast(9.9);
  EXPECT_EQ(state(), LifeState::kLost);
  coast(10.1);
  EXPECT_TRUE(map.objects().empty());
  ASSERT_EQ(map.retired().size(), 1u);
  EXPECT_EQ(map.retired()[0].life_state(), LifeState::kRetired);
  EXPECT_NE(map.retired()[0].surface().MeanBlock({-1, 0, 0}), nullptr);  // still exportable
  // The id again after retirement: another generation.
  frame = FrameAt(200);
  frame.objects.push_back(Created(5, Pose::Identity()));
  map.Apply(frame);
  EXPECT_EQ(map.objects().at(ObjectId(5)).generation(), 2u);
}

TEST(ObjectSubmap, AMotionKeepsThePoseExactWhileUnseen) {
  WorldMap map(MapConfig{});
  MapUpdate frame = FrameAt(0);
  frame.objects.push_back(Created(5, Pose::Identity()));
  map.Apply(frame);
  const ObjectSubmap& object = map.objects().at(ObjectId(5));
  for (uint64_t k = 1; k <= 150; ++k) {
    frame = FrameAt(k);
    frame.objects.push_back(
        Moved(object, Pose(Eigen::Translation3d(0.1, 0, 0)), /*observed=*/false));
    map.Apply(frame);
    ASSERT_EQ(object.life_state(), LifeState::kCoasting);
  }
  EXPECT_NEAR(object.T_W_L().translation().x(), 15, 1e-9);
  const ObjectView view = object.View(150 * kPeriod_ns);
  EXPECT_NEAR(view.twist.linear_mps.x(), 1.0, 1e-9);
  EXPECT_NEAR(view.PoseAt(2.0).translation().x(), 17, 1e-9);
}

TEST(ObjectSubmap, SmoothingReducesJitterOfTheTwist) {
  WorldMap map(MapConfig{});
  MapUpdate frame = FrameAt(0);
  frame.objects.push_back(Created(5, Pose::Identity()));
  map.Apply(frame);
  const ObjectSubmap& object = map.objects().at(ObjectId(5));
  std::mt19937 rng(4);
  std::normal_distribution<double> jitter(0, 0.05);
  double previous = 0, worst = 0;
  for (int k = 1; k <= 60; ++k) {  // 5 m/s, positions 5 cm off: single motions are 0.7 m/s off
    const double x = 0.5 * k + jitter(rng);
    frame = FrameAt(k);
    frame.objects.push_back(Moved(object, Pose(Eigen::Translation3d(x - previous, 0, 0)), true));
    previous = x;
    map.Apply(frame);
    if (k > 10) {
      worst = std::max(worst, std::abs(object.View(k * kPeriod_ns).twist.linear_mps.x() - 5));
    }
  }
  EXPECT_LT(worst, 0.4);
}

TEST(WorldMap, PathsStayBoundedAndSpanTheWholeDrive) {
  std::vector<PoseStamp> path;
  for (int i = 0; i < 100'000; ++i) AppendPose(path, {i, Pose::Identity()}, 64);
  EXPECT_LE(path.size(), 64u);
  EXPECT_EQ(path.front().stamp_ns, 0);
  EXPECT_EQ(path.back().stamp_ns, 99'999);
}

}  // namespace
}  // namespace clearance
