// The whole way: frames in over the wire, distances out, real computation between.
#include <chrono>
#include <cmath>
#include <thread>

#include "server/engine/live_map.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

// A wall at x = 4 in W, seen by a depth camera at the origin that looks along x.
v1::Frame WallFrame(uint64_t id) {
  v1::Frame frame = ProtoFrame(id, 0);
  // Columns of R_W_X: camera right = -y, down = -z, forward = +x.
  v1::Pose* pose = frame.mutable_world_from_sensor();
  pose->set_qx(-0.5);
  pose->set_qy(0.5);
  pose->set_qz(-0.5);
  pose->set_qw(0.5);
  v1::DepthImage* depth = frame.mutable_depth();
  depth->set_width(320);
  depth->set_height(240);
  depth->set_fx(200);
  depth->set_fy(200);
  depth->set_cx(159.5);
  depth->set_cy(119.5);
  depth->set_depth_scale_m(0.001);
  depth->set_depth_u16(Bytes(std::vector<uint16_t>(320 * 240, 4000)));
  return frame;
}

class LiveServerTest : public ServiceFixture {
 protected:
  void StartLive(const std::string& socket = "") {
    RegistryOptions registry;
    registry.model = LiveMapFactory();
    ServerOptions options;
    options.socket = socket;
    StartServer(std::move(registry), options);
  }
};

TEST_F(LiveServerTest, AWallSeenByADepthCameraIsAsFarAwayAsItIs) {
  StartLive();
  for (uint64_t id = 1; id <= 5; ++id) {
    ASSERT_EQ(Ingest(WallFrame(id)).status(), v1::INGEST_STATUS_INTEGRATED);
  }
  std::vector<float> points;
  for (float x = 1.0f; x < 3.9f; x += 0.17f) points.insert(points.end(), {x, 0.1f, -0.2f});
  v1::QueryPointsRequest request;
  request.set_positions_f32(Bytes(points));
  request.set_gradients(true);
  v1::QueryPointsResponse response;
  ASSERT_TRUE(Query(request, &response).ok());
  const auto distances = Values<float>(response.distances_f32());
  const auto gradients = Values<float>(response.gradients_f32());
  for (size_t i = 0; i < distances.size(); ++i) {
    const float truth = 4.0f - points[3 * i];
    EXPECT_NEAR(distances[i], truth, 0.03) << "x = " << points[3 * i];
    EXPECT_LT(gradients[3 * i], -0.9f) << "away from the wall";
    EXPECT_EQ(response.states_u8()[i] & 3, truth > 0.1 ? 1 : response.states_u8()[i] & 3);
  }
  EXPECT_EQ(response.stamp().revision(), 5u);
  EXPECT_EQ(response.stamp().field_revision(), 5u);
}

TEST_F(LiveServerTest, AnObjectIsListedMeshedAndAskedFor) {
  StartLive();
  for (uint64_t id = 1; id <= 4; ++id) {
    v1::Frame frame = WallFrame(id);
    std::vector<uint16_t> depth(320 * 240, 4000), labels(320 * 240, 0);
    for (int v = 90; v < 150; ++v) {
      for (int u = 130; u < 190; ++u) {
        depth[v * 320 + u] = 2000;
        labels[v * 320 + u] = 9;
      }
    }
    frame.mutable_depth()->set_depth_u16(Bytes(depth));
    frame.mutable_depth()->set_labels_u16(Bytes(labels));
    v1::ObjectMotion* motion = frame.add_motions();
    motion->set_object_id(9);
    motion->set_class_name("box");
    motion->mutable_world_from_object()->set_tx_m(2.0);
    motion->mutable_world_from_object()->set_qw(1);
    ASSERT_EQ(Ingest(frame, "", "camera").status(), v1::INGEST_STATUS_INTEGRATED);
  }
  grpc::ClientContext list_context, slice_context, mesh_context;
  v1::ListObjectsRequest list;
  list.set_include_history(true);
  v1::ListObjectsResponse objects;
  ASSERT_TRUE(query_->ListObjects(&list_context, list, &objects).ok());
  ASSERT_EQ(objects.objects_size(), 1);
  const v1::ObjectInfo& object = objects.objects(0);
  EXPECT_EQ(object.brief().object_id(), 9u);
  EXPECT_EQ(object.brief().class_name(), "box");
  EXPECT_EQ(object.brief().life_state(), v1::LIFE_STATE_TRACKED);
  EXPECT_EQ(object.source_id(), "camera");
  EXPECT_EQ(object.observations(), 4u);
  EXPECT_EQ(Values<int64_t>(object.history_stamps_i64()).size(), 4u);
  EXPECT_EQ(Values<double>(object.history_poses_f64()).size(), 28u);

  v1::QueryPointsRequest request = OnePoint(1.5f, 0, 0);
  request.set_objects(true);
  v1::QueryPointsResponse response;
  ASSERT_TRUE(Query(request, &response).ok());
  EXPECT_NEAR(Values<float>(response.distances_f32())[0], 0.5, 0.05);
  EXPECT_EQ(Values<uint32_t>(response.object_ids_u32())[0], 9u);
  ASSERT_EQ(response.objects_size(), 1);
  request.mutable_layers()->set_static_only(true);
  ASSERT_TRUE(Query(request, &response).ok());
  EXPECT_GT(Values<float>(response.distances_f32())[0], 2.0);

  v1::GetSliceResponse slice;
  ASSERT_TRUE(query_->GetSlice(&slice_context, {}, &slice).ok());
  EXPECT_GT(slice.columns() * slice.rows(), 1000u);
  EXPECT_EQ(slice.objects_size(), 1);

  v1::ExportMeshRequest mesh;
  mesh.set_object_id(9);
  auto reader = exports_->ExportMesh(&mesh_context, mesh);
  v1::ExportMeshResponse chunk;
  ASSERT_TRUE(reader->Read(&chunk));
  EXPECT_GT(chunk.triangles(), 40u) << "a square of 0.6 m in voxels of 0.1 m";
  EXPECT_DOUBLE_EQ(chunk.world_from_object().tx_m(), 2.0);
  while (reader->Read(&chunk)) continue;
  EXPECT_TRUE(reader->Finish().ok());
}

TEST_F(LiveServerTest, IngestQueriesEditsExportsAndDrainMayAllRunAtOnce) {
  StartLive(SocketPath());
  std::atomic<bool> stop = false;
  std::atomic<int> answered = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 2; ++t) {
    threads.emplace_back([&] {
      uint64_t last = 0;
      v1::QueryPointsRequest request;
      request.set_positions_f32(Bytes(std::vector<float>(3 * 6000, 3.0f)));
      request.set_gradients(true);
      request.set_objects(true);
      while (!stop) {
        v1::QueryPointsResponse response;
        if (!Query(request, &response).ok()) continue;
        EXPECT_GE(response.stamp().revision(), last) << "revisions never go back";
        last = response.stamp().revision();
        ++answered;
      }
    });
  }
  threads.emplace_back([&] {
    while (!stop) {
      grpc::ClientContext edit_context, mesh_context, stats_context;
      v1::EditRegionRequest edit;
      edit.set_action(v1::EDIT_ACTION_MARK_FREE);
      edit.mutable_sphere()->mutable_center()->set_x_m(1);
      edit.mutable_sphere()->set_radius_m(0.5);
      v1::EditRegionResponse edited;
      map_->EditRegion(&edit_context, edit, &edited);
      auto reader = exports_->ExportMesh(&mesh_context, {});
      v1::ExportMeshResponse chunk;
      while (reader->Read(&chunk)) continue;
      reader->Finish();
      v1::GetStatsResponse stats;
      admin_->GetStats(&stats_context, {}, &stats);
    }
  });
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  for (uint64_t id = 1; id <= 15; ++id) {
    ASSERT_TRUE(client.Send(WallFrame(id)));
    EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_INTEGRATED);
  }
  EXPECT_TRUE(server_->Drain());
  stop = true;
  for (std::thread& thread : threads) thread.join();
  EXPECT_GT(answered, 0);
  EXPECT_EQ(client.Drain().error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(client.closing()->last_frame_id(), 15u);
}

}  // namespace
}  // namespace clearance
