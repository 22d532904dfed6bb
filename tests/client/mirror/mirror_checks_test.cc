// Checks of robots on a mirror against the server's own, to the bit.
#include <cmath>
#include <future>
#include <random>

#include "client/esdf_client.h"
#include "server/engine/live_map.h"
#include "tests/client/live_server.h"
#include "tests/client/mirror/mirror_fixture.h"

namespace clearance::testing {
namespace {

using client::Mirror;

class MirrorChecks : public MirrorFixture {
 protected:
  // The same of checks: random timed paths and poses of a robot of several spheres, under every
  // kind of option.
  void ExpectEqualChecks(const Mirror& mirror, uint32_t seed) {
    client::ClientOptions options;
    options.address = address();
    const auto client = client::EsdfClient::Connect(options);
    ASSERT_TRUE(client.ok()) << client.status();
    const auto remote = client::MakeRemoteDistanceSource(**client);
    const int64_t stamp_ns = mirror.View()->stamp_ns;
    std::vector<uint32_t> ids;
    for (const ObjectView& object : mirror.View()->objects) ids.push_back(object.id.value());
    std::mt19937 random(seed);
    for (int trial = 0; trial < 12; ++trial) {
      client::CheckOptions check;
      check.margin_m = trial % 3 == 0 ? 0.0 : 0.1 * trial;
      check.unknown_as_free = trial % 2 == 0;
      check.sigma_margin = trial % 4 == 3 ? 1.5 : 0.0;
      check.static_only = trial == 5;
      if (trial == 6 && !ids.empty()) check.only_objects = ids;
      if (trial == 7 && !ids.empty()) check.without_objects = {ids[0]};
      if (trial % 4 == 1) check.reference_ns = stamp_ns + 250'000'000;
      const std::vector<client::Sphere> robot = {{{0.F, 0.F, 0.1F}, 0.3F},
                                                 {{0.4F, -0.1F, 0.F}, 0.2F}};
      std::vector<client::Trajectory> trajectories(20);
      std::vector<Pose> poses;
      std::vector<double> times_s;
      for (client::Trajectory& trajectory : trajectories) {
        const Eigen::Matrix3Xd at_W = RandomPoints(1 + random() % 4, random());
        for (Eigen::Index k = 0; k < at_W.cols(); ++k) {
          Pose pose = Pose::Identity();
          pose.linear() = Eigen::AngleAxisd(1e-9 * static_cast<double>(random()),
                                            Eigen::Vector3d(0.1, -0.3, 1.0).normalized())
                              .toRotationMatrix();
          pose.translation() = at_W.col(k);
          trajectory.T_W_R.push_back(pose);
          trajectory.times_s.push_back(0.5 * static_cast<double>(k) +
                                       1e-10 * static_cast<double>(random()));
          poses.push_back(pose);
          times_s.push_back(trajectory.times_s.back());
        }
      }
      const auto theirs = remote->CheckTrajectories(robot, trajectories, check);
      const auto ours = mirror.CheckTrajectories(robot, trajectories, check);
      ASSERT_TRUE(theirs.ok()) << theirs.status();
      ASSERT_TRUE(ours.ok()) << ours.status();
      EXPECT_EQ(theirs->stamp.revision, ours->stamp.revision);
      EXPECT_EQ(theirs->reference_ns, ours->reference_ns);
      ASSERT_EQ(theirs->results.size(), ours->results.size());
      for (size_t i = 0; i < ours->results.size(); ++i) {
        ExpectSameResult(theirs->results[i], ours->results[i]);
        (ours->results[i].collides ? colliding_ : clear_) += 1;
      }
      for (const bool timed : {false, true}) {
        const std::vector<double> times = timed ? times_s : std::vector<double>();
        const auto their = remote->CheckSpheres(robot, poses, times, check);
        const auto our = mirror.CheckSpheres(robot, poses, times, check);
        ASSERT_TRUE(their.ok()) << their.status();
        ASSERT_TRUE(our.ok()) << our.status();
        EXPECT_EQ(their->stamp.revision, our->stamp.revision);
        EXPECT_EQ(their->reference_ns, our->reference_ns);
        EXPECT_EQ(their->collides, our->collides);
        EXPECT_EQ(their->clearances_m, our->clearances_m);
        EXPECT_EQ(their->sphere_indices, our->sphere_indices);
        EXPECT_EQ(their->object_ids, our->object_ids);
      }
    }
  }
  static void ExpectSameResult(const client::TrajectoryResult& a,
                               const client::TrajectoryResult& b) {
    EXPECT_EQ(a.collides, b.collides);
    EXPECT_EQ(a.first_collision_s, b.first_collision_s);
    EXPECT_EQ(a.last_valid_s, b.last_valid_s);
    EXPECT_EQ(a.last_valid_index, b.last_valid_index);
    EXPECT_EQ(a.min_clearance_m, b.min_clearance_m);
    EXPECT_EQ(a.min_clearance_s, b.min_clearance_s);
    EXPECT_EQ(a.object_id, b.object_id);
    EXPECT_EQ(a.twist.linear_mps, b.twist.linear_mps);
    EXPECT_EQ(a.twist.angular_radps, b.twist.angular_radps);
    EXPECT_EQ(a.unknown_decides, b.unknown_decides);
  }

  int colliding_ = 0, clear_ = 0;
};

TEST_F(MirrorChecks, EqualTheServersBitForBitOverRandomChanges) {
  for (const uint32_t seed : {21u, 22u}) {
    StartServer(seed);
    const auto mirror = StartMirror(Options());
    for (int step = 0; step < 60; ++step) {
      Step();
      if (step % 20 != 19) continue;
      ExpectEqualNow(*mirror);
      ExpectEqualChecks(*mirror, seed + static_cast<uint32_t>(step));
    }
  }
  EXPECT_GT(colliding_, 100);
  EXPECT_GT(clear_, 10);
}

TEST_F(MirrorChecks, EqualTheServersOnARealMapWithAMovingObject) {
  RegistryOptions registry;
  registry.model = LiveMapFactory();
  StartServer(std::move(registry));
  const auto mirror = StartMirror(Options());
  for (uint64_t i = 0; i < 6; ++i) {
    Frame frame = client::RoomFrame(i, true);
    frame.source_id = "default";
    Push(std::move(frame));
  }
  ExpectEqualNow(*mirror);
  ASSERT_EQ(mirror->View()->objects.size(), 1u);
  ExpectEqualChecks(*mirror, 5);
  EXPECT_GT(colliding_, 10);
  EXPECT_GT(clear_, 10);
}

TEST_F(MirrorChecks, RefuseWhatTheServerRefuses) {
  StartServer(16);
  Step();
  const auto mirror = StartMirror(Options());
  ExpectEqualNow(*mirror);
  client::ClientOptions options;
  options.address = address();
  const auto client = client::EsdfClient::Connect(options);
  ASSERT_TRUE(client.ok()) << client.status();
  const auto remote = client::MakeRemoteDistanceSource(**client);
  const std::vector<client::Sphere> ball = {{Eigen::Vector3f::Zero(), 0.5F}};
  const std::vector<Pose> two(2, Pose::Identity());
  const auto expect_same = [&](const std::vector<client::Sphere>& robot,
                               const client::Trajectory& path) {
    const absl::Status theirs = remote->CheckTrajectories(robot, {path}, {}).status();
    const absl::Status ours = mirror->CheckTrajectories(robot, {path}, {}).status();
    EXPECT_FALSE(ours.ok());
    EXPECT_EQ(theirs.code(), ours.code()) << theirs << "\n" << ours;
  };
  expect_same(ball, {{}, {}});
  expect_same(ball, {two, {1.0, 0.5}});
  expect_same(ball, {two, {0.0, 99.0}});
  expect_same(ball, {two, {-1.0, 0.5}});
  expect_same(ball, {two, {0.0, NAN}});
  expect_same({}, {two, {0.0, 1.0}});
  expect_same({{Eigen::Vector3f::Zero(), -0.5F}}, {two, {0.0, 1.0}});
  expect_same(std::vector<client::Sphere>(100'000, ball[0]), {two, {0.0, 1.0}});
}

}  // namespace
}  // namespace clearance::testing
