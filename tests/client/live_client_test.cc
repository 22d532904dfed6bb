// The C++ client against a running server.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "client/distance_source.h"
#include "client/esdf_client.h"
#include "tests/client/live_server.h"

namespace clearance::client {
namespace {

using ::testing::HasSubstr;

wire::MapSettings Voxels(double voxel_size_m) {
  wire::MapSettings settings;
  settings.voxel_size_m = voxel_size_m;
  return settings;
}

// Sends frames 0..n-1 and waits for them.
absl::Status SendRoom(const EsdfClient& client, uint64_t n, bool with_object,
                      std::vector<FrameAck>* acks = nullptr) {
  IngestOptions options;
  options.source_id = "lidar";
  options.on_ack = [acks](const FrameAck& ack) {
    if (acks != nullptr) acks->push_back(ack);
  };
  auto stream = client.OpenIngest(options);
  if (!stream.ok()) return stream.status();
  for (uint64_t i = 0; i < n; ++i) {
    if (absl::Status s = (*stream)->Send(RoomFrame(i, with_object)); !s.ok()) return s;
  }
  return (*stream)->Finish();
}

TEST(LiveClient, MeasuresARoomThatItStreamedIn) {
  const LiveServer server;
  const auto client = server.Connect("room");
  ASSERT_NE(client, nullptr);
  ASSERT_TRUE(*client->IsServing());
  ASSERT_TRUE(client->CreateMap("room", Voxels(0.1)).ok());
  std::vector<FrameAck> acks;
  const absl::Status sent = SendRoom(*client, 5, false, &acks);
  ASSERT_TRUE(sent.ok()) << sent;
  ASSERT_EQ(acks.size(), 5u);
  for (const FrameAck& ack : acks) EXPECT_EQ(ack.status, AckStatus::kIntegrated);

  QueryOptions options;
  options.gradients = options.objects = options.sigmas = true;
  options.min_revision = acks.back().stamp.revision;
  options.wait_s = 10;
  Eigen::Matrix3Xd points(3, 3);
  points << 0, 2, 0,  //
      0, 0, -2.5,     //
      0, 0, 0;
  const auto answers = client->QueryPoints(points, options);
  ASSERT_TRUE(answers.ok()) << answers.status();
  EXPECT_NEAR(answers->distances_m[0], 1.5, 0.06);
  EXPECT_NEAR(answers->distances_m[1], 1.0, 0.06);
  EXPECT_NEAR(answers->distances_m[2], 0.5, 0.06);
  EXPECT_LT((answers->gradients_W.col(1) - Eigen::Vector3f(-1, 0, 0)).norm(), 0.2);
  EXPECT_LT((answers->gradients_W.col(2) - Eigen::Vector3f(0, 1, 0)).norm(), 0.2);
  for (const uint8_t state : answers->states) EXPECT_EQ(StateOf(state), SpaceState::kFree);

  const auto source = MakeRemoteDistanceSource(*client);
  const auto again = source->Distances(points, 0.0);
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->distances_m, answers->distances_m);

  const auto info = client->GetMap("", /*include_trajectory=*/true);
  ASSERT_TRUE(info.ok()) << info.status();
  EXPECT_EQ(info->sensor_path.size(), 5u);
  ASSERT_EQ(info->sources.size(), 1u);
  EXPECT_EQ(info->sources[0].last_frame_id, 4u);
}

TEST(LiveClient, ARobotIsCheckedByEveryRoad) {
  const LiveServer server;
  const auto client = server.Connect("room");
  ASSERT_NE(client, nullptr);
  ASSERT_TRUE(client->CreateMap("room", Voxels(0.1)).ok());
  ASSERT_TRUE(SendRoom(*client, 8, true).ok());
  const auto source = MakeRemoteDistanceSource(*client);
  // Before the wall at x = -3, and beside the box that drives off at 1 m/s.
  const std::vector<Sphere> robot = {{{0, 0, 0}, 0.3f}};
  std::vector<Trajectory> paths(2);
  for (Trajectory& path : paths) {
    path.T_W_R.assign(2, Pose::Identity());
    path.times_s = {0, 1};
  }
  paths[0].T_W_R[0].translation() << -1, 0, 0;
  paths[0].T_W_R[1].translation() << -2.9, 0, 0;
  paths[1].T_W_R[0].translation() << 1.2, 0, 0;
  paths[1].T_W_R[1].translation() << 2.2, 0, 0;
  CheckOptions options;
  options.unknown_as_free = true;
  const auto checked = source->CheckTrajectories(robot, paths, options);
  ASSERT_TRUE(checked.ok()) << checked.status();
  ASSERT_TRUE(checked->results[0].collides);
  EXPECT_NEAR(checked->results[0].first_collision_s, 1.7 / 1.9, 0.05);
  // It follows the box at the box's own speed.
  EXPECT_FALSE(checked->results[1].collides);
  EXPECT_EQ(checked->results[1].object_id, 7u);
  EXPECT_NEAR(checked->results[1].twist.linear_mps.x(), 1, 0.05);
  EXPECT_EQ(checked->stamp.revision, source->Stamp()->revision);

  const auto poses =
      source->CheckSpheres(robot, {paths[0].T_W_R[0], paths[0].T_W_R[1]}, {}, options);
  ASSERT_TRUE(poses.ok()) << poses.status();
  EXPECT_EQ(poses->collides, (std::vector<uint8_t>{0, 1}));
  const Eigen::Matrix3Xd same = Eigen::Vector3d(1, 0, 0).replicate(1, 2);
  const auto distances = source->Distances(same, std::vector<float>{0, 0.5f});
  ASSERT_TRUE(distances.ok()) << distances.status();
  EXPECT_NEAR(distances->distances_m[1] - distances->distances_m[0], 0.5, 0.1);

  // The same in a pipeline, an error among it.
  const auto stream = client->OpenQueryStream();
  int right = 0, wrong = 0;
  for (int i = 0; i < 100; ++i) {
    std::vector<Trajectory> asked = paths;
    if (i == 50) asked[1].times_s = {1, 0};
    stream->CheckTrajectories(robot, asked, options, [&, i](const auto& answers) {
      if (i == 50) {
        wrong += absl::IsInvalidArgument(answers.status());
      } else {
        right += answers.ok() && answers->results[0].collides && !answers->results[1].collides;
      }
    });
  }
  const absl::Status finished = stream->Finish();
  EXPECT_TRUE(finished.ok()) << finished;
  EXPECT_EQ(right, 99);
  EXPECT_EQ(wrong, 1);

  // One world for a planning cycle.
  const auto pin = client->PinRevision();
  ASSERT_TRUE(pin.ok()) << pin.status();
  wire::EditRegion edit;
  edit.action = v1::EDIT_ACTION_MARK_OCCUPIED;
  edit.box = Aabb(Eigen::Vector3d(-1.6, -0.5, -0.5), Eigen::Vector3d(-1.2, 0.5, 0.5));
  ASSERT_TRUE(client->EditRegion("room", edit).ok());
  const auto now = source->CheckSpheres(robot, {paths[0].T_W_R[0]}, {}, options);
  ASSERT_TRUE(now.ok()) << now.status();
  EXPECT_EQ(now->collides[0], 1);
  options.pin_id = pin->id;
  const auto then = source->CheckSpheres(robot, {paths[0].T_W_R[0]}, {}, options);
  ASSERT_TRUE(then.ok()) << then.status();
  EXPECT_EQ(then->collides[0], 0);
  ASSERT_TRUE(client->ReleasePin("room", pin->id).ok());
  EXPECT_TRUE(
      absl::IsNotFound(source->CheckSpheres(robot, {paths[0].T_W_R[0]}, {}, options).status()));

  // A region agrees with the points.
  RegionOptions region;
  region.bounds = Aabb(Eigen::Vector3d(-2.5, -2, -1), Eigen::Vector3d(2.5, 2, 1));
  size_t cells = 0;
  const absl::Status taken = client->GetRegion(region, [&](const RegionBlock& block) {
    cells += block.states.size();
    const auto at = client->QueryPoints(block.origin_W);
    EXPECT_EQ(at->distances_m[0], block.distances_m[0]);
    return absl::OkStatus();
  });
  EXPECT_TRUE(taken.ok()) << taken;
  EXPECT_EQ(cells, 50u * 40 * 20);
  EXPECT_EQ(client->GetRegion(
                region, [](const RegionBlock&) { return absl::ResourceExhaustedError("enough"); }),
            absl::ResourceExhaustedError("enough"));
}

TEST(LiveClient, SeesAnObjectMoveAndAhead) {
  const LiveServer server;
  const auto client = server.Connect("room");
  ASSERT_NE(client, nullptr);
  ASSERT_TRUE(client->CreateMap("room", Voxels(0.1)).ok());
  ASSERT_TRUE(SendRoom(*client, 8, true).ok());
  const auto list = client->ListObjects(/*include_history=*/true);
  ASSERT_TRUE(list.ok()) << list.status();
  ASSERT_EQ(list->objects.size(), 1u);
  const ObjectInfo& object = list->objects[0];
  EXPECT_EQ(object.brief.object_id, 7u);
  EXPECT_EQ(object.brief.class_name, "box");
  EXPECT_EQ(object.brief.life, ObjectLife::kTracked);
  EXPECT_NEAR(object.brief.twist.linear_mps.x(), 1.0, 0.05);
  EXPECT_EQ(object.history.size(), 8u);

  // The front face, at 1.2 m + 0.1 m a frame; half a second later 0.5 m farther.
  QueryOptions options;
  options.objects = true;
  const Eigen::Matrix3Xd point = Eigen::Vector3d(1.0, 0, 0);
  const auto now = client->QueryPoints(point, options);
  ASSERT_TRUE(now.ok()) << now.status();
  EXPECT_NEAR(now->distances_m[0], 0.9, 0.08);
  EXPECT_EQ(now->object_ids[0], 7u);
  options.horizon_s = 0.5;
  const auto later = client->QueryPoints(point, options);
  ASSERT_TRUE(later.ok()) << later.status();
  EXPECT_NEAR(later->distances_m[0], 1.4, 0.1);
}

TEST(LiveClient, ABadFrameIsRejectedAndTheStreamLives) {
  const LiveServer server;
  const auto client = server.Connect();
  ASSERT_NE(client, nullptr);
  std::vector<FrameAck> acks;
  IngestOptions options;
  options.on_ack = [&](const FrameAck& ack) { acks.push_back(ack); };
  auto stream = client->OpenIngest(options);
  ASSERT_TRUE(stream.ok()) << stream.status();
  ASSERT_TRUE((*stream)->Send(RoomFrame(0)).ok());
  Frame bad = RoomFrame(1);
  std::get<PointCloud>(bad.observation).points_X(1, 33) = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE((*stream)->Send(bad).ok());
  ASSERT_TRUE((*stream)->Send(RoomFrame(2)).ok());
  const absl::Status finished = (*stream)->Finish();
  ASSERT_TRUE(finished.ok()) << finished;
  ASSERT_EQ(acks.size(), 3u);
  std::sort(acks.begin(), acks.end(),
            [](const auto& a, const auto& b) { return a.frame_id < b.frame_id; });
  EXPECT_EQ(acks[0].status, AckStatus::kIntegrated);
  EXPECT_EQ(acks[1].status, AckStatus::kRejected);
  ASSERT_EQ(acks[1].violations.size(), 1u);
  EXPECT_EQ(acks[1].violations[0].field, "frame.cloud.points_f32");
  EXPECT_EQ(acks[1].violations[0].index, 33);
  EXPECT_EQ(acks[2].status, AckStatus::kIntegrated);
  EXPECT_EQ(client->GetMap()->stamp.revision, acks[0].stamp.revision + 1);
}

TEST(LiveClient, CutConnectionsLoseNothingAndRepeatNothing) {
  const LiveServer server;
  ASSERT_NE(server.Connect(), nullptr);
  CuttingProxy proxy(server.address());
  ClientOptions client_options;
  client_options.address = proxy.address();
  const auto client = EsdfClient::Connect(client_options);
  ASSERT_TRUE(client.ok()) << client.status();
  IngestOptions options;
  options.max_range_m = 10;
  auto stream = (*client)->OpenIngest(options);
  ASSERT_TRUE(stream.ok()) << stream.status();
  int cut = 0;
  for (uint64_t i = 0; i < 24; ++i) {
    const absl::Status sent = (*stream)->Send(RoomFrame(i));
    ASSERT_TRUE(sent.ok()) << i << " " << sent;
    if (i % 6 == 3) cut += proxy.Cut();
  }
  const absl::Status finished = (*stream)->Finish();
  ASSERT_TRUE(finished.ok()) << finished;
  EXPECT_GE(cut, 3);
  EXPECT_GE((*stream)->reconnects(), 1u);
  EXPECT_EQ((*stream)->last_frame_id(), 23u);
  const auto info = server.Connect()->GetMap();
  ASSERT_TRUE(info.ok()) << info.status();
  ASSERT_EQ(info->sources.size(), 1u);
  EXPECT_EQ(info->sources[0].frames_integrated, 24u);
  EXPECT_EQ(info->stamp.revision, 24u);
}

TEST(LiveClient, ContinuesWhereTheServerStands) {
  const LiveServer server;
  const auto client = server.Connect();
  ASSERT_NE(client, nullptr);
  ASSERT_TRUE(SendRoom(*client, 4, false).ok());
  IngestOptions options;
  options.source_id = "lidar";
  const auto stream = client->OpenIngest(options);
  ASSERT_TRUE(stream.ok()) << stream.status();
  EXPECT_EQ((*stream)->last_frame_id(), 3u);
  // A source that never sent stands nowhere.
  options.source_id = "other";
  EXPECT_EQ((*client->OpenIngest(options))->last_frame_id(), std::nullopt);
}

TEST(LiveClient, AServerThatLeavesIsUnavailableWithinTheGivenTime) {
  LiveServer server;
  const auto client = server.Connect();
  ASSERT_NE(client, nullptr);
  IngestOptions options;
  options.reconnect_for = absl::Milliseconds(600);
  auto stream = client->OpenIngest(options);
  ASSERT_TRUE(stream.ok()) << stream.status();
  ASSERT_TRUE((*stream)->Send(RoomFrame(0)).ok());
  EXPECT_EQ(server.Terminate(), 0);
  absl::Status status;
  for (uint64_t i = 1; i < 50 && status.ok(); ++i) status = (*stream)->Send(RoomFrame(i));
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("gave up reconnecting"));
  const auto answers = client->QueryPoints(Eigen::Vector3d(0, 0, 0));
  EXPECT_EQ(answers.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(answers.status().message()), HasSubstr(server.address()));
}

TEST(LiveClient, ErrorsOfTheServerKeepCodeAndText) {
  const LiveServer server;
  const auto client = server.Connect("nowhere");
  ASSERT_NE(client, nullptr);
  const Eigen::Matrix3Xd point = Eigen::Vector3d(0, 0, 0);
  const auto unknown_map = client->QueryPoints(point);
  EXPECT_EQ(unknown_map.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(unknown_map.status().message()), HasSubstr("default"));
  QueryOptions options;
  options.map = "default";
  EXPECT_EQ(client->QueryPoints(Eigen::Matrix3Xd(3, 0), options).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(client->CreateMap("default", Voxels(0.1)).status().code(),
            absl::StatusCode::kAlreadyExists);
  EXPECT_EQ(client->CreateMap("No Name", Voxels(0.1)).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(client->DeleteMap("nowhere").code(), absl::StatusCode::kNotFound);
  MeshOptions mesh;
  mesh.map = "default";
  mesh.object_id = 9;
  const auto sink = [](std::string_view) { return absl::OkStatus(); };
  EXPECT_EQ(client->ExportMesh(mesh, sink).status().code(), absl::StatusCode::kNotFound);
}

TEST(LiveClient, AFullDiskEndsAnExportWithItsOwnError) {
  const LiveServer server;
  const auto client = server.Connect();
  ASSERT_NE(client, nullptr);
  ASSERT_TRUE(SendRoom(*client, 3, false).ok());
  std::string ply;
  const auto result = client->ExportMesh({}, [&](std::string_view bytes) {
    ply.append(bytes);
    return absl::OkStatus();
  });
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->bytes, ply.size());
  EXPECT_GT(result->triangles, 1000u);
  EXPECT_EQ(ply.substr(0, 4), "ply\n");
  const auto full = client->ExportMesh(
      {}, [](std::string_view) { return absl::ResourceExhaustedError("disk full"); });
  EXPECT_EQ(full.status(), absl::ResourceExhaustedError("disk full"));
}

}  // namespace
}  // namespace clearance::client
