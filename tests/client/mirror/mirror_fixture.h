// A server in the test's process, on a unix socket, and what a mirror of it must equal.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <cstring>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "client/mirror/mirror.h"
#include "server/map/field_differences.h"
#include "server/query/surfel_tree.h"
#include "server/service/server.h"
#include "tests/client/test_files.h"
#include "tests/engine/scripted_model.h"

namespace clearance::testing {

inline constexpr absl::Duration kLong = absl::Seconds(120);

inline bool SameBytes(const void* a, const void* b, size_t size) {
  return std::memcmp(a, b, size) == 0;
}

inline void ExpectSameShape(const ObjectShape* a, const ObjectShape* b) {
  const size_t sites = a == nullptr ? 0 : a->sites.size();
  ASSERT_EQ(sites, b == nullptr ? 0 : b->sites.size());
  if (sites == 0) return;
  EXPECT_EQ(a->voxel_size_m, b->voxel_size_m);
  for (size_t i = 0; i < sites; ++i) {
    EXPECT_EQ(a->sites[i].p_L, b->sites[i].p_L);
    EXPECT_EQ(a->sites[i].normal_L, b->sites[i].normal_L);
    EXPECT_EQ(a->sites[i].sigma_m, b->sites[i].sigma_m);
  }
  ASSERT_EQ(a->tree->nodes.size(), b->tree->nodes.size());
  ASSERT_EQ(a->tree->leaves.size(), b->tree->leaves.size());
  EXPECT_TRUE(SameBytes(a->tree->nodes.data(), b->tree->nodes.data(),
                        a->tree->nodes.size() * sizeof(SurfelTree::Node)));
  for (size_t i = 0; i < a->tree->leaves.size(); ++i) {  // member by member: they end in padding
    const SurfelTree::Leaf &leaf = a->tree->leaves[i], &other = b->tree->leaves[i];
    EXPECT_TRUE(SameBytes(leaf.p, other.p, sizeof(leaf.p)));
    EXPECT_TRUE(SameBytes(leaf.normal, other.normal, sizeof(leaf.normal)));
    EXPECT_EQ(leaf.first, other.first);
    EXPECT_EQ(leaf.count, other.count);
  }
}

inline void ExpectSameObject(const ObjectView& a, const ObjectView& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.generation, b.generation);
  EXPECT_EQ(a.class_name, b.class_name);
  EXPECT_EQ(a.source_id, b.source_id);
  EXPECT_EQ(a.life_state, b.life_state);
  EXPECT_EQ(a.T_W_L.matrix(), b.T_W_L.matrix());
  EXPECT_EQ(a.twist.linear_mps, b.twist.linear_mps);
  EXPECT_EQ(a.twist.angular_radps, b.twist.angular_radps);
  EXPECT_EQ(a.screw_W, b.screw_W);
  EXPECT_EQ(a.position_sigma_m, b.position_sigma_m);
  EXPECT_EQ(a.velocity_sigma_mps, b.velocity_sigma_mps);
  EXPECT_EQ(a.first_seen_ns, b.first_seen_ns);
  EXPECT_EQ(a.last_seen_ns, b.last_seen_ns);
  EXPECT_EQ(a.observations, b.observations);
  ExpectSameShape(a.shape.get(), b.shape.get());
}

// Every voxel, tile, pose and site, to the bit.
inline void ExpectSameView(const MapView& server, const MapView& mirror) {
  EXPECT_EQ(server.epoch, mirror.epoch);
  EXPECT_EQ(server.revision, mirror.revision);
  EXPECT_EQ(server.field_revision, mirror.field_revision);
  EXPECT_EQ(server.stamp_ns, mirror.stamp_ns);
  EXPECT_EQ(server.field.voxel_size_m(), mirror.field.voxel_size_m());
  EXPECT_EQ(server.field.max_distance_m(), mirror.field.max_distance_m());
  int different = 0;
  for (const auto& d : DifferencesBetween(mirror.field, server.field)) {
    const bool same =
        d.tile_before == d.tile_after && d.before && d.after && d.before->voxels == d.after->voxels;
    different += !same;
  }
  EXPECT_EQ(different, 0) << "blocks";
  ASSERT_EQ(server.objects.size(), mirror.objects.size());
  for (size_t i = 0; i < server.objects.size(); ++i) {
    ExpectSameObject(server.objects[i], mirror.objects[i]);
  }
}

inline Eigen::Matrix3Xd RandomPoints(int count, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> plane(-8, 8), height(-2, 2);
  Eigen::Matrix3Xd points(3, count);
  for (int i = 0; i < count; ++i) points.col(i) << plane(random), plane(random), height(random);
  return points;
}

class MirrorFixture : public ::testing::Test {
 protected:
  // `default` exists, and changes by `seed`.
  void StartServer(uint32_t seed, int blocks_a_frame = 12) {
    RegistryOptions registry;
    registry.engine.kept_revisions = 100'000;  // to compare with, however late
    registry.model = [seed, blocks_a_frame](const MapConfig& config) {
      return std::make_unique<ScriptedModel>(config, seed, blocks_a_frame);
    };
    StartServer(std::move(registry));
  }
  void StartServer(RegistryOptions registry) {
    StopServer();
    frames_ = 0;
    registry_ = std::make_unique<MapRegistry>(std::move(registry));
    ASSERT_TRUE(registry_->Create("default", config_).ok());
    ServerOptions options;
    options.socket = address();
    auto server = ClearanceServer::Start(registry_.get(), options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
  }
  void StopServer() {
    server_.reset();
    registry_.reset();
  }
  std::string address() const { return (folder_.path() / "server.sock").string(); }
  MapRegistry::EnginePtr Engine() { return *registry_->Get("default"); }

  // One more revision, published when this returns.
  uint64_t Step() {
    Frame frame;
    frame.source_id = "default";
    frame.frame_id = ++frames_;
    frame.stamp_ns = static_cast<int64_t>(frames_) * 100'000'000;
    return Push(std::move(frame));
  }
  uint64_t Push(Frame frame) {
    std::mutex mu;
    std::condition_variable settled;
    uint64_t revision = 0;
    const Admission admission = Engine()->Submit(std::move(frame), [&](const FrameAck& ack) {
      std::lock_guard lock(mu);
      EXPECT_EQ(ack.status, FrameAck::Status::kIntegrated);
      revision = ack.stamp.revision;
      settled.notify_all();
    });
    EXPECT_EQ(admission, Admission::kTaken);
    std::unique_lock lock(mu);
    settled.wait(lock, [&] { return revision != 0; });
    return revision;
  }

  client::MirrorOptions Options(const std::string& socket = "") const {
    client::MirrorOptions options;
    options.client.address = socket.empty() ? address() : socket;
    options.first_backoff = absl::Milliseconds(5);
    options.max_backoff = absl::Milliseconds(50);
    return options;
  }
  std::unique_ptr<client::Mirror> StartMirror(const client::MirrorOptions& options) {
    auto mirror = client::Mirror::Start(options);
    EXPECT_TRUE(mirror.ok()) << mirror.status();
    return *std::move(mirror);
  }
  // Waits for the server's newest revision and compares everything.
  void ExpectEqualNow(const client::Mirror& mirror) {
    const ViewPtr newest = Engine()->Latest();
    const absl::Status reached = mirror.WaitForRevision(newest->revision, kLong, newest->epoch);
    ASSERT_TRUE(reached.ok()) << reached;
    const std::shared_ptr<const MapView> view = mirror.View();
    const absl::StatusOr<ViewPtr> same = Engine()->store().Find(view->revision);
    ASSERT_TRUE(same.ok()) << same.status();
    ExpectSameView(**same, *view);
  }

  MapConfig config_;
  client::TestFolder folder_;
  std::unique_ptr<MapRegistry> registry_;
  std::unique_ptr<ClearanceServer> server_;
  uint64_t frames_ = 0;
};

}  // namespace clearance::testing
