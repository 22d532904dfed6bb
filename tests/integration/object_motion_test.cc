#include "server/integration/object_motion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace clearance {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kVoxel_m = 0.1;
constexpr size_t kMinPoints = 8;

ObjectMotion Motion(uint16_t id, const Pose& H_W, std::optional<uint64_t> from = {}) {
  ObjectMotion m;
  m.object_id = ObjectId(id);
  m.pose = H_W;
  m.from_frame_id = from;
  return m;
}

ObjectMotion Absolute(uint16_t id, const Pose& T_W_L) {
  ObjectMotion m = Motion(id, T_W_L);
  m.kind = ObjectMotion::Kind::kWorldFromObject;
  return m;
}

Pose Shift(double x, double y = 0, double z = 0) { return Pose(Eigen::Translation3d(x, y, z)); }

// A map that follows a flat patch of an object's surface, as a front end would show it.
class ObjectMotionTest : public ::testing::Test {
 protected:
  // Runs a frame: the patch of object 3 lies 5 m ahead, moved by `patch`; motions as given.
  std::vector<ObjectTask> Run(uint64_t frame_id, std::vector<ObjectMotion> motions,
                              std::optional<Pose> patch, const std::string& source = "a") {
    Frame frame;
    frame.frame_id = frame_id;
    frame.stamp_ns = int64_t(frame_id) * 100'000'000;
    frame.source_id = source;
    frame.T_W_X = T_W_X_;
    frame.motions = std::move(motions);
    LabelledPoints labelled;
    Eigen::Matrix3Xf points(3, 400);
    if (patch) {
      for (int i = 0; i < 400; ++i) {
        const Eigen::Vector3d p_W(5, 0.05 * (i % 20), 0.05 * (i / 20));
        points.col(i) = (T_W_X_.inverse() * (*patch * p_W)).cast<float>();
        labelled[ObjectId(3)].push_back(i);
      }
    }
    violations_.clear();
    auto tasks = FollowObjects(frame, points, labelled, kMinPoints, map_, violations_);
    MapUpdate update;
    update.source_id = source;
    update.frame_id = frame.frame_id;
    update.stamp_ns = frame.stamp_ns;
    for (const ObjectTask& task : tasks) {
      update.objects.push_back(task.update);
      if (task.integrate && patch) FillBand(update.objects.back(), *patch);
    }
    map_.Apply(update);
    return tasks;
  }

  // Exact distances to the patch's plane, in L.
  void FillBand(ObjectUpdate& u, const Pose& patch) {
    std::map<BlockIndex, std::map<int, float>> blocks;
    for (int i = -2; i <= 1; ++i) {
      for (int y = 0; y < 11; ++y) {
        for (int z = 0; z < 11; ++z) {
          const Eigen::Vector3d p_L =
              u.T_W_L.inverse() * (patch * Eigen::Vector3d(5 + 0.1 * i + 0.05, 0.1 * y, 0.1 * z));
          const VoxelIndex v = VoxelOf(p_L, kVoxel_m);
          const Eigen::Vector3d centre = patch.inverse() * (u.T_W_L * VoxelCentre(v, kVoxel_m));
          blocks[BlockOf(v)][OffsetOf(v)] = static_cast<float>(5 - centre.x());
        }
      }
    }
    for (const auto& [block, voxels] : blocks) {
      const uint32_t begin = u.surface.band.offset.size();
      for (const auto& [offset, d] : voxels) {
        u.surface.band.offset.push_back(offset);
        u.surface.band.distance_m.push_back(d);
        u.surface.band.weight.push_back(1.f);
      }
      u.surface.band.blocks.push_back(
          {block, begin, static_cast<uint32_t>(u.surface.band.offset.size())});
    }
  }

  const ObjectSubmap& object() const { return map_.objects().at(ObjectId(3)); }

  Pose T_W_X_ = Shift(1, 2, 3);
  WorldMap map_{MapConfig{}};
  std::vector<Violation> violations_;
};

TEST_F(ObjectMotionTest, NewObjectStartsAtTheCentroidUnrotated) {
  const auto tasks = Run(0, {}, Shift(0));
  ASSERT_THAT(tasks, SizeIs(1));
  EXPECT_EQ(tasks[0].update.event, ObjectEvent::kCreated);
  EXPECT_TRUE(tasks[0].integrate);
  EXPECT_TRUE(tasks[0].update.T_W_L.isApprox(Shift(5, 0.475, 0.475), 1e-6));
  EXPECT_THAT(violations_, IsEmpty());
}

TEST_F(ObjectMotionTest, KnownObjectFollowsItsMotion) {
  Run(0, {}, Shift(0));
  Pose H = Shift(0.3, 0.1, 0);
  H.linear() = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const auto tasks = Run(1, {Motion(3, H)}, H);
  EXPECT_EQ(tasks.at(0).update.event, ObjectEvent::kMoved);
  EXPECT_TRUE(object().T_W_L().isApprox(H * Shift(5, 0.475, 0.475), 1e-6));
  EXPECT_TRUE(tasks[0].integrate);
}

TEST_F(ObjectMotionTest, MotionForAnObjectNeverSeenIsRefusedAlone) {
  const auto tasks = Run(1, {Motion(9, Shift(1)), Motion(3, Shift(1))}, Shift(0));
  ASSERT_THAT(violations_, SizeIs(1));
  EXPECT_EQ(violations_[0].index, 0);
  EXPECT_THAT(violations_[0].description, HasSubstr("object 9 was never seen"));
  EXPECT_EQ(tasks.size(), 1u);
  EXPECT_EQ(map_.revision(), 1u);
}

TEST_F(ObjectMotionTest, MotionAfterAGapIsRefusedAndTheObjectCoasts) {
  Run(0, {}, Shift(0));
  Run(1, {Motion(3, Shift(0.5))}, Shift(0.5));
  Run(2, {}, std::nullopt);  // no motion: it coasts at 5 m/s
  EXPECT_NEAR(object().T_W_L().translation().x(), 6.0, 1e-6);
  const auto tasks = Run(3, {Motion(3, Shift(0.5))}, std::nullopt);
  ASSERT_THAT(violations_, SizeIs(1));
  EXPECT_THAT(violations_[0].description,
              HasSubstr("starts at frame 2, but the object's pose is of no frame"));
  EXPECT_EQ(tasks.at(0).update.event, ObjectEvent::kCoasted);
  EXPECT_NEAR(object().T_W_L().translation().x(), 6.5, 1e-6);
  EXPECT_EQ(object().life_state(), LifeState::kCoasting);
}

TEST_F(ObjectMotionTest, MotionFromAnotherFrameThanThePosesIsRefused) {
  Run(0, {}, Shift(0));
  Run(1, {Motion(3, Shift(0.5))}, Shift(0.5));
  Run(2, {Motion(3, Shift(0.5), /*from=*/0)}, std::nullopt);
  ASSERT_THAT(violations_, SizeIs(1));
  EXPECT_THAT(violations_[0].description,
              HasSubstr("starts at frame 0, but the object's pose is of frame 1"));
  Run(3, {Motion(3, Shift(0.5), /*from=*/1)}, std::nullopt);  // it coasted meanwhile
  EXPECT_THAT(violations_, SizeIs(1));
}

TEST_F(ObjectMotionTest, MissedFramesAreNoGapWhenTheMotionSpansThem) {
  Run(0, {}, Shift(0));
  const auto tasks = Run(5, {Motion(3, Shift(2.5), /*from=*/0)}, Shift(2.5));
  EXPECT_THAT(violations_, IsEmpty());
  EXPECT_NEAR(object().T_W_L().translation().x(), 7.5, 1e-6);
  EXPECT_NEAR(tasks.at(0).update.motion_period_s, 0.5, 1e-9);
}

TEST_F(ObjectMotionTest, ReanchorsWhereItsPointsFitTheSubmap) {
  Run(0, {}, Shift(0));
  Run(1, {Motion(3, Shift(0.5))}, Shift(0.5));
  Run(2, {}, std::nullopt);
  const auto tasks = Run(3, {Motion(3, Shift(0.5))}, Shift(1.52));  // where it coasted to, 2 cm off
  EXPECT_EQ(tasks.at(0).update.event, ObjectEvent::kReanchored);
  EXPECT_TRUE(tasks[0].integrate);
  EXPECT_EQ(object().generation(), 1u);
  Run(4, {Motion(3, Shift(0.5))}, Shift(2.02));
  EXPECT_THAT(violations_, IsEmpty());  // the chain holds again
  EXPECT_EQ(object().life_state(), LifeState::kTracked);
}

TEST_F(ObjectMotionTest, PointsElsewhereAfterAGapStartANewGeneration) {
  Run(0, {}, Shift(0));
  Run(1, {Motion(3, Shift(0.5))}, Shift(0.5));
  Run(2, {}, std::nullopt);
  const auto tasks = Run(3, {Motion(3, Shift(0.5))}, Shift(3.0));
  EXPECT_EQ(tasks.at(0).update.event, ObjectEvent::kCreated);
  EXPECT_EQ(object().generation(), 2u);
  ASSERT_THAT(map_.retired(), SizeIs(1));
  EXPECT_EQ(map_.retired()[0].generation(), 1u);
}

TEST_F(ObjectMotionTest, PointsWithoutAUsablePoseGoNowhere) {
  Run(0, {}, Shift(0));
  Run(1, {Motion(3, Shift(0.5))}, Shift(0.5));
  Run(2, {}, std::nullopt);
  const auto tasks = Run(3, {}, Shift(3.0));  // not where it should be, and not followed
  EXPECT_EQ(tasks.at(0).update.event, ObjectEvent::kCoasted);
  EXPECT_FALSE(tasks[0].integrate);
}

TEST_F(ObjectMotionTest, AbsolutePoseReanchorsWithoutALookAtThePoints) {
  Run(0, {Absolute(3, Shift(5))}, Shift(0));
  EXPECT_TRUE(object().T_W_L().isApprox(Shift(5), 1e-9));
  Run(1, {}, std::nullopt);
  const auto tasks = Run(2, {Absolute(3, Shift(9))}, Shift(4));
  EXPECT_EQ(tasks.at(0).update.event, ObjectEvent::kReanchored);
  EXPECT_TRUE(object().T_W_L().isApprox(Shift(9), 1e-9));
  EXPECT_EQ(object().generation(), 1u);
}

TEST_F(ObjectMotionTest, OneSourceOwnsAnObjectUntilItIsLost) {
  Run(0, {}, Shift(0), "a");
  const auto tasks = Run(1, {Motion(3, Shift(1))}, Shift(1), "b");
  EXPECT_THAT(tasks, IsEmpty());
  ASSERT_THAT(violations_, SizeIs(1));
  EXPECT_THAT(violations_[0].description, HasSubstr("followed by source 'a'"));
  EXPECT_NEAR(object().T_W_L().translation().x(), 5, 1e-6);
  Run(40, {}, std::nullopt, "a");  // 4 s later: lost
  EXPECT_EQ(object().life_state(), LifeState::kLost);
  Run(41, {Absolute(3, Shift(6))}, Shift(1), "b");
  EXPECT_THAT(violations_, IsEmpty());
  EXPECT_EQ(object().source_id(), "b");
}

}  // namespace
}  // namespace clearance
