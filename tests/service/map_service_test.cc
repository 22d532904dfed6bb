#include "clearance/v1/map.pb.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

class MapServiceTest : public ServiceFixture {
 protected:
  grpc::Status Create(const v1::CreateMapRequest& request, v1::MapInfo* info = nullptr) {
    grpc::ClientContext context;
    v1::CreateMapResponse response;
    const grpc::Status status = map_->CreateMap(&context, request, &response);
    if (info != nullptr) *info = response.info();
    return status;
  }
  grpc::Status Edit(const v1::EditRegionRequest& request, v1::EditRegionResponse* response) {
    grpc::ClientContext context;
    return map_->EditRegion(&context, request, response);
  }
  grpc::health::v1::HealthCheckResponse::ServingStatus HealthOf(const std::string& service) {
    grpc::ClientContext context;
    grpc::health::v1::HealthCheckRequest request;
    request.set_service(service);
    grpc::health::v1::HealthCheckResponse response;
    const grpc::Status status = health_->Check(&context, request, &response);
    if (status.error_code() == Code::NOT_FOUND) {
      return grpc::health::v1::HealthCheckResponse::SERVICE_UNKNOWN;
    }
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.status();
  }
};

TEST_F(MapServiceTest, AMapIsCreatedWithDefaultsInForce) {
  StartServer();
  v1::CreateMapRequest request;
  request.set_map("yard");
  request.mutable_config()->set_voxel_size_m(0.02);
  v1::MapInfo info;
  const grpc::Status status = Create(request, &info);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(info.map(), "yard");
  EXPECT_EQ(info.config().voxel_size_m(), 0.02);
  EXPECT_NEAR(info.config().max_distance_m(), 2.4, 1e-9) << "the default 5 m would be 250 voxels";
  EXPECT_GT(info.config().truncation_m(), 0);
  EXPECT_EQ(info.config().max_range_m(), 25);
  EXPECT_EQ(info.config().overload_policy(), v1::OVERLOAD_POLICY_BLOCK);
  EXPECT_EQ(info.stamp().revision(), 0u);
  EXPECT_EQ(Create(request).error_code(), Code::ALREADY_EXISTS);
}

TEST_F(MapServiceTest, ABadIdOrConfigIsRefusedByName) {
  StartServer();
  v1::CreateMapRequest request;
  request.set_map("Not Good");
  EXPECT_THAT(Create(request).error_message(), HasSubstr("[a-z][a-z0-9_-]{0,62}"));
  request.set_map("good");
  const auto refused = [&](const char* field, auto spoil) {
    v1::CreateMapRequest bad = request;
    spoil(bad.mutable_config());
    const grpc::Status status = Create(bad);
    EXPECT_EQ(status.error_code(), Code::INVALID_ARGUMENT) << field;
    EXPECT_THAT(status.error_message(), HasSubstr(field));
  };
  refused("config.voxel_size_m", [](v1::MapConfig* c) { c->set_voxel_size_m(-0.1); });
  refused("config.voxel_size_m", [](v1::MapConfig* c) { c->set_voxel_size_m(NAN); });
  refused("config.max_distance_m", [](v1::MapConfig* c) { c->set_max_distance_m(100); });
  refused("config.truncation_m", [](v1::MapConfig* c) { c->set_truncation_m(7); });
  refused("config.overload_policy",
          [](v1::MapConfig* c) { c->set_overload_policy(static_cast<v1::OverloadPolicy>(9)); });
  refused("config.bounds", [](v1::MapConfig* c) {
    c->mutable_bounds()->mutable_min()->set_x_m(1);
    c->mutable_bounds()->mutable_max();
  });
  refused("retired", [](v1::MapConfig* c) { c->mutable_object_times()->set_retire_after_s(1); });
  EXPECT_TRUE(Create(request).ok());
}

TEST_F(MapServiceTest, TooManyMapsAreRetryable) {
  RegistryOptions registry;
  registry.max_maps = 1;
  StartServer(std::move(registry));
  v1::CreateMapRequest request;
  request.set_map("yard");
  const grpc::Status status = Create(request);
  EXPECT_EQ(status.error_code(), Code::RESOURCE_EXHAUSTED);
  EXPECT_FALSE(status.error_details().empty());
}

TEST_F(MapServiceTest, ListsInOrderAndDeletes) {
  StartServer();
  for (const char* id : {"b", "a"}) {
    v1::CreateMapRequest request;
    request.set_map(id);
    ASSERT_TRUE(Create(request).ok());
  }
  EXPECT_EQ(HealthOf("maps/a"), grpc::health::v1::HealthCheckResponse::SERVING);
  grpc::ClientContext list, gone, again;
  v1::ListMapsResponse maps;
  ASSERT_TRUE(map_->ListMaps(&list, {}, &maps).ok());
  ASSERT_EQ(maps.maps_size(), 3);
  EXPECT_EQ(maps.maps(0).map(), "a");
  EXPECT_EQ(maps.maps(1).map(), "b");
  EXPECT_EQ(maps.maps(2).map(), "default");
  v1::DeleteMapRequest request;
  request.set_map("a");
  v1::DeleteMapResponse deleted;
  EXPECT_TRUE(map_->DeleteMap(&gone, request, &deleted).ok());
  EXPECT_EQ(map_->DeleteMap(&again, request, &deleted).error_code(), Code::NOT_FOUND);
  EXPECT_NE(HealthOf("maps/a"), grpc::health::v1::HealthCheckResponse::SERVING);
}

TEST_F(MapServiceTest, AMapShowsItsSources) {
  StartServer();
  Ingest(ProtoFrame(4), "", "lidar");
  v1::Frame bad = ProtoFrame(5);
  bad.set_submap_id("x");
  Ingest(bad, "", "lidar");
  grpc::ClientContext context;
  v1::GetMapRequest request;
  request.set_include_trajectory(true);
  v1::GetMapResponse response;
  ASSERT_TRUE(map_->GetMap(&context, request, &response).ok());
  ASSERT_EQ(response.info().sources_size(), 1);
  const v1::SourceInfo& source = response.info().sources(0);
  EXPECT_EQ(source.source_id(), "lidar");
  EXPECT_EQ(source.last_frame_id(), 5u);
  EXPECT_EQ(source.last_stamp_ns(), 400'000'000);
  EXPECT_EQ(source.frames_integrated(), 1u);
  EXPECT_EQ(source.frames_rejected(), 1u);
}

TEST_F(MapServiceTest, EditsARegionAndMakesARevision) {
  StartServer();
  v1::EditRegionRequest request;
  request.set_action(v1::EDIT_ACTION_MARK_OCCUPIED);
  request.mutable_sphere()->mutable_center();
  request.mutable_sphere()->set_radius_m(1);
  v1::EditRegionResponse response;
  ASSERT_TRUE(Edit(request, &response).ok());
  EXPECT_EQ(response.stamp().revision(), 1u);
  EXPECT_EQ(response.changed_voxels(), 7u);
  EXPECT_EQ(log_->edits, 1);
}

TEST_F(MapServiceTest, RefusesBadEdits) {
  StartServer();
  v1::EditRegionRequest good;
  good.set_action(v1::EDIT_ACTION_MARK_FREE);
  good.mutable_sphere()->mutable_center();
  good.mutable_sphere()->set_radius_m(1);
  v1::EditRegionResponse response;
  const auto refused = [&](const char* field, Code code, auto spoil) {
    v1::EditRegionRequest bad = good;
    spoil(&bad);
    const grpc::Status status = Edit(bad, &response);
    EXPECT_EQ(status.error_code(), code) << field;
    EXPECT_THAT(status.error_message(), HasSubstr(field));
  };
  refused("action", Code::INVALID_ARGUMENT, [](auto* r) { r->clear_action(); });
  refused("action", Code::INVALID_ARGUMENT,
          [](auto* r) { r->set_action(static_cast<v1::EditAction>(77)); });
  refused("region", Code::INVALID_ARGUMENT, [](auto* r) { r->clear_region(); });
  refused("radius", Code::INVALID_ARGUMENT, [](auto* r) { r->mutable_sphere()->set_radius_m(-1); });
  refused("center", Code::INVALID_ARGUMENT,
          [](auto* r) { r->mutable_sphere()->mutable_center()->set_x_m(NAN); });
  refused("box", Code::INVALID_ARGUMENT, [](auto* r) {
    r->mutable_box()->mutable_min()->set_x_m(2);
    r->mutable_box()->mutable_max()->set_x_m(1);
  });
  refused("nowhere", Code::NOT_FOUND, [](auto* r) { r->set_map("nowhere"); });
  EXPECT_EQ(Revision(), 0u);
}

TEST_F(MapServiceTest, HealthKnowsServicesAndMapsAndTheDrain) {
  using Health = grpc::health::v1::HealthCheckResponse;
  StartServer();
  for (const char* name :
       {"", "clearance.v1.QueryService", "clearance.v1.IngestService", "clearance.v1.MapService",
        "clearance.v1.ExportService", "clearance.v1.AdminService", "clearance.v1.WatchService",
        "maps/default"}) {
    EXPECT_EQ(HealthOf(name), Health::SERVING) << name;
  }
  EXPECT_EQ(HealthOf("clearance.v1.SnapshotService"), Health::NOT_SERVING);
  EXPECT_EQ(HealthOf("maps/nowhere"), Health::SERVICE_UNKNOWN);
}

TEST_F(MapServiceTest, AdminTellsLimitsAndStatistics) {
  StartServer();
  Ingest(ProtoFrame(1));
  Ingest(ProtoFrame(1));
  grpc::ClientContext info_context, stats_context, unknown_context, drain_context;
  v1::GetServerInfoResponse info;
  ASSERT_TRUE(admin_->GetServerInfo(&info_context, {}, &info).ok());
  EXPECT_EQ(info.api_version(), "v1");
  EXPECT_FALSE(info.version().empty());
  EXPECT_EQ(info.limits().max_query_points(), 100'000u);
  ASSERT_EQ(info.maps_size(), 1);
  v1::GetStatsResponse stats;
  ASSERT_TRUE(admin_->GetStats(&stats_context, {}, &stats).ok());
  ASSERT_EQ(stats.maps_size(), 1);
  EXPECT_EQ(stats.maps(0).frames_integrated(), 1u);
  EXPECT_EQ(stats.maps(0).frames_duplicate(), 1u);
  EXPECT_GT(stats.maps(0).stages_size(), 0);
  EXPECT_GT(stats.resident_bytes(), 0u);
  EXPECT_GT(stats.threads(), 1u);
  EXPECT_GT(stats.calls_size(), 0);
  v1::GetStatsRequest unknown;
  unknown.set_map("nowhere");
  EXPECT_EQ(admin_->GetStats(&unknown_context, unknown, &stats).error_code(), Code::NOT_FOUND);
}

}  // namespace
}  // namespace clearance
