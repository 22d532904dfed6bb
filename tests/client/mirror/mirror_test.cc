#include "client/mirror/mirror.h"

#include <atomic>
#include <future>
#include <random>
#include <thread>

#include "client/esdf_client.h"
#include "server/engine/live_map.h"
#include "tests/client/live_server.h"
#include "tests/client/mirror/mirror_fixture.h"

namespace clearance::testing {
namespace {

using client::CuttingProxy;
using client::Mirror;
using client::MirrorStatus;
using ::testing::HasSubstr;

class MirrorTest : public MirrorFixture {
 protected:
  // The same bytes from the server, over the wire, and from the mirror.
  void ExpectEqualAnswers(const Mirror& mirror, double horizon_s, uint32_t seed) {
    client::ClientOptions options;
    options.address = address();
    const auto client = client::EsdfClient::Connect(options);
    ASSERT_TRUE(client.ok()) << client.status();
    const auto remote = client::MakeRemoteDistanceSource(**client);
    const Eigen::Matrix3Xd points = RandomPoints(500, seed);
    const auto theirs = remote->Distances(points, horizon_s);
    const auto ours = mirror.Distances(points, horizon_s);
    ASSERT_TRUE(theirs.ok()) << theirs.status();
    ASSERT_TRUE(ours.ok()) << ours.status();
    EXPECT_EQ(theirs->stamp.revision, ours->stamp.revision);
    EXPECT_EQ(theirs->reference_ns, ours->reference_ns);
    EXPECT_EQ(theirs->distances_m, ours->distances_m);
    EXPECT_EQ(theirs->gradients_W, ours->gradients_W);
    EXPECT_EQ(theirs->object_ids, ours->object_ids);
    ASSERT_EQ(theirs->states.size(), ours->states.size());
    for (size_t i = 0; i < ours->states.size(); ++i) {
      // Asked at different moments, one may be stale already.
      EXPECT_EQ(theirs->states[i] & ~client::kFlagStale, ours->states[i] & ~client::kFlagStale);
    }
    ASSERT_EQ(theirs->objects.size(), ours->objects.size());
    for (size_t i = 0; i < ours->objects.size(); ++i) {
      EXPECT_EQ(theirs->objects[i].T_W_L.matrix(), ours->objects[i].T_W_L.matrix());
      EXPECT_EQ(theirs->objects[i].twist.linear_mps, ours->objects[i].twist.linear_mps);
      EXPECT_EQ(theirs->objects[i].generation, ours->objects[i].generation);
    }
  }
};

TEST_F(MirrorTest, EqualsTheServerBitForBitOverRandomChanges) {
  for (const uint32_t seed : {1u, 2u, 3u}) {
    StartServer(seed);
    std::mt19937 random(seed);
    for (uint64_t before = random() % 20; before > 0; --before) Step();
    const auto mirror = StartMirror(Options());
    for (int step = 0; step < 150; ++step) {
      Step();
      if (random() % 3 == 0) ExpectEqualNow(*mirror);
    }
    ExpectEqualNow(*mirror);
    for (const double horizon_s : {0.0, 0.7, 3.0}) ExpectEqualAnswers(*mirror, horizon_s, seed);
    const MirrorStatus status = mirror->Status();
    EXPECT_EQ(status.checkpoints, 1u);
    EXPECT_GT(status.deltas, 10u);
    EXPECT_EQ(status.connects, 1u);
  }
}

TEST_F(MirrorTest, ResumesWhereTheConnectionWasCut) {
  StartServer(4);
  CuttingProxy proxy(address());
  std::mt19937 random(4);
  Step();
  const auto mirror = StartMirror(Options(proxy.address()));
  ASSERT_TRUE(mirror->WaitUntilReady(kLong).ok());
  int cuts = 0;
  for (int step = 0; step < 300; ++step) {
    Step();
    if (random() % 10 == 0) cuts += proxy.Cut();
    if (random() % 4 == 0) ExpectEqualNow(*mirror);
  }
  ExpectEqualNow(*mirror);
  const MirrorStatus status = mirror->Status();
  EXPECT_GT(cuts, 5);
  EXPECT_GT(status.resumes, 0u);
  EXPECT_EQ(status.resumes + 1, status.connects);
  EXPECT_EQ(status.checkpoints, 1u) << "everything was told twice";
}

TEST_F(MirrorTest, StartsOverWhenTheServerRestarts) {
  StartServer(5);
  for (int i = 0; i < 10; ++i) Step();
  const auto mirror = StartMirror(Options());
  ExpectEqualNow(*mirror);
  const uint64_t first_epoch = mirror->Status().stamp.epoch;
  StartServer(6);
  Step();
  ExpectEqualNow(*mirror);
  EXPECT_NE(mirror->Status().stamp.epoch, first_epoch);
  for (int i = 0; i < 20; ++i) Step();
  ExpectEqualNow(*mirror);
}

TEST_F(MirrorTest, FollowsAMapThatIsDeletedAndMadeAgain) {
  StartServer(7);
  for (int i = 0; i < 10; ++i) Step();
  const auto mirror = StartMirror(Options());
  ExpectEqualNow(*mirror);
  const std::shared_ptr<const MapView> last = mirror->View();
  ASSERT_TRUE(registry_->Delete("default").ok());
  while (!absl::IsNotFound(mirror->Status().last_error)) std::this_thread::yield();
  EXPECT_EQ(mirror->View(), last) << "the last view stays, to be aged";
  EXPECT_FALSE(mirror->Status().connected);
  ASSERT_TRUE(registry_->Create("default", config_).ok());
  frames_ = 0;
  Step();
  ExpectEqualNow(*mirror);
  EXPECT_NE(mirror->View()->epoch, last->epoch);
}

TEST_F(MirrorTest, TwentyMirrorsFollowOneMapAtOnce) {
  StartServer(8);
  Step();
  std::vector<std::unique_ptr<Mirror>> mirrors;
  for (int i = 0; i < 20; ++i) {
    client::MirrorOptions options = Options();
    if (i % 5 == 4) options.max_rate_hz = 200;
    mirrors.push_back(StartMirror(options));
    Step();
  }
  for (int i = 0; i < 100; ++i) Step();
  for (const auto& mirror : mirrors) ExpectEqualNow(*mirror);
  for (const auto& mirror : mirrors) EXPECT_EQ(mirror->Status().checkpoints, 1u);
}

TEST_F(MirrorTest, QueriesRunWhileTheMirrorMovesOn) {
  StartServer(9);
  Step();
  const auto mirror = StartMirror(Options());
  ASSERT_TRUE(mirror->WaitUntilReady(kLong).ok());
  std::atomic<bool> stop = false;
  std::vector<std::thread> readers;
  for (uint32_t r = 0; r < 3; ++r) {
    readers.emplace_back([&, r] {
      const Eigen::Matrix3Xd points = RandomPoints(50, r);
      uint64_t revision = 0;
      while (!stop) {
        const auto answers = mirror->Distances(points, 0.5);
        ASSERT_TRUE(answers.ok()) << answers.status();
        EXPECT_GE(answers->stamp.revision, revision);
        revision = answers->stamp.revision;
      }
    });
  }
  for (int i = 0; i < 100; ++i) Step();
  ExpectEqualNow(*mirror);
  stop = true;
  for (std::thread& reader : readers) reader.join();
}

TEST_F(MirrorTest, AgesAndSaysSoWhenTheServerDisappears) {
  StartServer(10);
  Step();
  client::MirrorOptions options = Options();
  options.stale_after_s = 0.2;
  const auto mirror = StartMirror(options);
  ExpectEqualNow(*mirror);
  StopServer();
  const Eigen::Matrix3Xd points = RandomPoints(20, 1);
  const auto before = mirror->Distances(points, 0);
  ASSERT_TRUE(before.ok());
  while (!mirror->Status().stale) std::this_thread::yield();
  const MirrorStatus status = mirror->Status();
  EXPECT_GT(status.age_s, 0.2);
  EXPECT_GT(status.silence_s, 0.0);
  EXPECT_TRUE(status.ready);
  const auto after = mirror->Distances(points, 0);
  ASSERT_TRUE(after.ok());
  EXPECT_GT(after->stamp.staleness_s, before->stamp.staleness_s);
  for (const uint8_t state : after->states) EXPECT_TRUE(state & client::kFlagStale);
  EXPECT_EQ(after->distances_m, before->distances_m);
  while (mirror->Status().connected) std::this_thread::yield();
  EXPECT_TRUE(absl::IsUnavailable(mirror->Status().last_error)) << mirror->Status().last_error;
  StartServer(11);
  Step();
  ExpectEqualNow(*mirror);
  EXPECT_TRUE(mirror->Status().connected);
}

TEST_F(MirrorTest, HoldsOnlyTheBlocksOfItsBounds) {
  StartServer(12);
  for (int i = 0; i < 30; ++i) Step();
  client::MirrorOptions options = Options();
  options.bounds = Aabb(Eigen::Vector3d(-2, -2, -1), Eigen::Vector3d(1, 3, 1));
  const auto mirror = StartMirror(options);
  for (int i = 0; i < 30; ++i) Step();
  const ViewPtr newest = Engine()->Latest();
  ASSERT_TRUE(mirror->WaitForRevision(newest->revision, kLong).ok());
  const auto view = mirror->View();
  const double side_m = kBlockSide * config_.voxel_size_m;
  size_t inside = 0;
  view->field.ForEach([&](const BlockIndex& b, const auto&, uint8_t) {
    ++inside;
    const Eigen::Vector3d low = BlockOrigin(b, config_.voxel_size_m);
    EXPECT_TRUE(options.bounds->intersects(Aabb(low, low.array() + side_m)));
  });
  EXPECT_GT(inside, 0u);
  for (const auto& d : DifferencesBetween(view->field, newest->field)) {
    const Eigen::Vector3d low = BlockOrigin(d.index, config_.voxel_size_m);
    if (!options.bounds->intersects(Aabb(low, low.array() + side_m))) continue;
    ASSERT_EQ(d.before == nullptr, d.after == nullptr);
    EXPECT_EQ(d.tile_before, d.tile_after);
    if (d.after) {
      EXPECT_EQ(d.before->voxels, d.after->voxels);
    }
  }
  ASSERT_EQ(view->objects.size(), newest->objects.size());
}

TEST_F(MirrorTest, PosesOnlyBringsNoBlocksAndNoSurfaces) {
  StartServer(13);
  for (int i = 0; i < 30; ++i) Step();
  client::MirrorOptions options = Options();
  options.poses_only = true;
  const auto mirror = StartMirror(options);
  for (int i = 0; i < 30; ++i) Step();
  const ViewPtr newest = Engine()->Latest();
  ASSERT_TRUE(mirror->WaitForRevision(newest->revision, kLong).ok());
  const auto view = mirror->View();
  EXPECT_TRUE(view->field.empty());
  EXPECT_EQ(mirror->Status().block_bytes, 0u);
  EXPECT_EQ(mirror->Status().surface_bytes, 0u);
  ASSERT_EQ(view->objects.size(), newest->objects.size());
  for (size_t i = 0; i < view->objects.size(); ++i) {
    EXPECT_EQ(view->objects[i].T_W_L.matrix(), newest->objects[i].T_W_L.matrix());
    EXPECT_EQ(view->objects[i].shape, nullptr);
  }
}

TEST_F(MirrorTest, EqualsARealMapWithEditsAndAMovingObject) {
  RegistryOptions registry;
  registry.engine.kept_revisions = 1000;
  registry.model = LiveMapFactory();
  StartServer(std::move(registry));
  const auto mirror = StartMirror(Options());
  for (uint64_t i = 0; i < 8; ++i) {
    Frame frame = client::RoomFrame(i, true);
    frame.source_id = "default";
    Push(std::move(frame));
    if (i == 4) {
      std::promise<void> edited;
      RegionEdit edit;
      edit.sphere_centre = Eigen::Vector3d(2, 1, 0);
      edit.sphere_radius_m = 0.8;
      edit.action = RegionAction::kMarkOccupied;
      ASSERT_TRUE(Engine()
                      ->EditRegion(edit,
                                   [&](const auto& done, const RevisionStamp&) {
                                     EXPECT_TRUE(done.ok());
                                     edited.set_value();
                                   })
                      .ok());
      edited.get_future().wait();
    }
    ExpectEqualNow(*mirror);
  }
  EXPECT_EQ(mirror->View()->objects.size(), 1u);
  for (const double horizon_s : {0.0, 1.0}) ExpectEqualAnswers(*mirror, horizon_s, 1);
}

TEST_F(MirrorTest, AskedTooEarlyOrBadlyItSaysWhy) {
  client::MirrorOptions options = Options();
  const auto mirror = StartMirror(options);  // there is no server
  const auto early = mirror->Distances(RandomPoints(1, 1), 0);
  EXPECT_TRUE(absl::IsUnavailable(early.status()));
  EXPECT_THAT(early.status().message(), HasSubstr("no map yet"));
  EXPECT_TRUE(mirror->Status().stale);
  const absl::Status late = mirror->WaitForRevision(3, absl::Milliseconds(1));
  EXPECT_TRUE(absl::IsDeadlineExceeded(late));
  EXPECT_THAT(late.message(), HasSubstr("revision 3"));

  StartServer(14);
  ASSERT_TRUE(mirror->WaitUntilReady(kLong).ok());
  EXPECT_TRUE(absl::IsInvalidArgument(mirror->Distances(Eigen::Matrix3Xd(3, 0), 0).status()));
  Eigen::Matrix3Xd points = RandomPoints(3, 1);
  EXPECT_TRUE(absl::IsOutOfRange(mirror->Distances(points, 99).status()));
  EXPECT_TRUE(absl::IsOutOfRange(mirror->Distances(points, -1).status()));
  points(1, 2) = NAN;
  EXPECT_THAT(mirror->Distances(points, 0).status().message(), HasSubstr("points_W[2]"));

  options.max_rate_hz = -1;
  EXPECT_THAT(Mirror::Start(options).status().message(), HasSubstr("max_rate_hz"));
  options = Options();
  options.bounds = Aabb();
  EXPECT_THAT(Mirror::Start(options).status().message(), HasSubstr("bounds"));
  options = Options();
  options.first_backoff = absl::ZeroDuration();
  EXPECT_THAT(Mirror::Start(options).status().message(), HasSubstr("first_backoff"));
}

TEST_F(MirrorTest, RefusesAMapBeyondItsMemoryLimit) {
  StartServer(15, 40);
  for (int i = 0; i < 20; ++i) Step();
  client::MirrorOptions options = Options();
  options.memory_limit_bytes = 100'000;
  const auto mirror = StartMirror(options);
  while (!absl::IsResourceExhausted(mirror->Status().last_error)) std::this_thread::yield();
  EXPECT_THAT(mirror->Status().last_error.message(), HasSubstr("memory_limit_bytes"));
  EXPECT_FALSE(mirror->Status().ready);
}

}  // namespace
}  // namespace clearance::testing
