#include <chrono>
#include <functional>
#include <thread>

#include "clearance/v1/query.pb.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

struct BadQuery {
  const char* name;
  Code code;
  std::vector<std::string> said;  // parts of the text
  std::function<void(v1::QueryPointsRequest*)> spoil;
};

const BadQuery kBadQueries[] = {
    {"no points", Code::INVALID_ARGUMENT, {}, [](auto* r) { r->clear_positions_f32(); }},
    {"length",
     Code::INVALID_ARGUMENT,
     {"positions_f32", "13"},
     [](auto* r) { r->set_positions_f32(std::string(13, 'x')); }},
    {"length f64",
     Code::INVALID_ARGUMENT,
     {"positions_f64", "25"},
     [](auto* r) {
       r->clear_positions_f32();
       r->set_positions_f64(std::string(25, 'x'));
     }},
    {"two fields",
     Code::INVALID_ARGUMENT,
     {"positions_f64"},
     [](auto* r) { r->set_positions_f64(std::string(24, 0)); }},
    {"not a number",
     Code::INVALID_ARGUMENT,
     {"positions_f32[1]"},
     [](auto* r) {
       r->set_positions_f32(Bytes(std::vector<float>{0, 0, 0, 0, NAN, 0}));
     }},
    {"too many",
     Code::INVALID_ARGUMENT,
     {"100001", "100000"},
     [](auto* r) { r->set_positions_f32(std::string(100'001 * 12, 0)); }},
    {"too many by hand",
     Code::INVALID_ARGUMENT,
     {"positions_xyz", "64"},
     [](auto* r) {
       r->clear_positions_f32();
       for (int i = 0; i < 65 * 3; ++i) r->add_positions_xyz(0);
     }},
    {"unknown fusion",
     Code::INVALID_ARGUMENT,
     {"fusion", "9"},
     [](auto* r) { r->set_fusion(static_cast<v1::Fusion>(9)); }},
    {"horizons of another length",
     Code::INVALID_ARGUMENT,
     {"horizons_f32"},
     [](auto* r) {
       r->set_horizons_f32(Bytes(std::vector<float>{0, 1}));
     }},
    {"horizon not finite",
     Code::INVALID_ARGUMENT,
     {"horizon_s"},
     [](auto* r) { r->set_horizon_s(NAN); }},
    {"negative maximum",
     Code::INVALID_ARGUMENT,
     {"max_distance_m"},
     [](auto* r) { r->set_max_distance_m(-1); }},
    {"maximum beyond the map's",
     Code::INVALID_ARGUMENT,
     {"max_distance_m", "7", "5"},
     [](auto* r) { r->set_max_distance_m(7); }},
    {"negative margin",
     Code::INVALID_ARGUMENT,
     {"sigma_margin"},
     [](auto* r) { r->set_sigma_margin(-1); }},
    {"negative wait",
     Code::INVALID_ARGUMENT,
     {"wait_s"},
     [](auto* r) { r->mutable_consistency()->set_wait_s(-1); }},
    {"wait too long",
     Code::INVALID_ARGUMENT,
     {"wait_s", "60"},
     [](auto* r) { r->mutable_consistency()->set_wait_s(61); }},
    {"layers that exclude each other",
     Code::INVALID_ARGUMENT,
     {"layers"},
     [](auto* r) {
       r->mutable_layers()->set_static_only(true);
       r->mutable_layers()->add_only_objects(1);
     }},
    {"object id out of range",
     Code::INVALID_ARGUMENT,
     {"only_objects"},
     [](auto* r) { r->mutable_layers()->add_only_objects(70'000); }},
    {"unknown object",
     Code::NOT_FOUND,
     {"7"},
     [](auto* r) { r->mutable_layers()->add_only_objects(7); }},
    {"bad map id",
     Code::INVALID_ARGUMENT,
     {"map", "No Map"},
     [](auto* r) { r->set_map("No Map"); }},
    {"unknown map",
     Code::NOT_FOUND,
     {"'yard' does not exist", "Maps: default"},
     [](auto* r) { r->set_map("yard"); }},
    {"horizon before",
     Code::OUT_OF_RANGE,
     {"horizon_s", "stamp 100000000", "5"},
     [](auto* r) { r->set_horizon_s(-0.5); }},
    {"horizon beyond",
     Code::OUT_OF_RANGE,
     {"horizon_s", "5.5", "limit 5"},
     [](auto* r) { r->set_horizon_s(5.5); }},
    {"time before",
     Code::OUT_OF_RANGE,
     {"at_ns", "stamp 100000000"},
     [](auto* r) { r->set_at_ns(99'000'000); }},
    {"time far out", Code::OUT_OF_RANGE, {"at_ns"}, [](auto* r) { r->set_at_ns(INT64_MIN); }},
    {"reference before",
     Code::OUT_OF_RANGE,
     {"stamp 100000000"},
     [](auto* r) {
       r->set_reference_ns(1);
       r->set_horizon_s(0);
     }},
    {"one horizon beyond",
     Code::OUT_OF_RANGE,
     {"horizons_f32[1]", "limit 5"},
     [](auto* r) {
       r->set_positions_f32(std::string(24, 0));
       r->set_horizons_f32(Bytes(std::vector<float>{1, 9}));
     }},
    {"other epoch",
     Code::FAILED_PRECONDITION,
     {"consistency.epoch", "got 1"},
     [](auto* r) { r->mutable_consistency()->set_epoch(1); }},
    {"unknown pin",
     Code::NOT_FOUND,
     {"pin 3"},
     [](auto* r) { r->mutable_consistency()->set_pin_id(3); }},
    {"revision not reached",
     Code::ABORTED,
     {"min_revision", "9", "at 1"},
     [](auto* r) { r->mutable_consistency()->set_min_revision(9); }},
};

class QueryServiceTest : public ServiceFixture {};

TEST_F(QueryServiceTest, EveryBadInputGetsItsCodeAndSaysWhatIsWrong) {
  StartServer();
  Ingest(ProtoFrame(1));
  for (const BadQuery& bad : kBadQueries) {
    SCOPED_TRACE(bad.name);
    v1::QueryPointsRequest request = OnePoint();
    bad.spoil(&request);
    v1::QueryPointsResponse response;
    const grpc::Status status = Query(request, &response);
    EXPECT_EQ(status.error_code(), bad.code) << status.error_message();
    for (const std::string& part : bad.said) {
      EXPECT_THAT(status.error_message(), HasSubstr(part));
    }
  }
  EXPECT_EQ(Revision(), 1u);
}

TEST_F(QueryServiceTest, InvalidArgumentsCarryTheFieldAsADetail) {
  StartServer();
  v1::QueryPointsRequest request = OnePoint();
  request.set_positions_f32(Bytes(std::vector<float>{0, 0, 0, 0, NAN, 0}));
  v1::QueryPointsResponse response;
  const grpc::Status status = Query(request, &response);
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(status.error_details()));
  ASSERT_EQ(details.details_size(), 1);
  google::rpc::BadRequest bad;
  ASSERT_TRUE(details.details(0).UnpackTo(&bad));
  EXPECT_THAT(bad.field_violations(0).field(), HasSubstr("positions_f32"));
}

TEST_F(QueryServiceTest, AnswersEveryPointAndOnlyTheArraysThatWereAskedFor) {
  StartServer();
  Ingest(ProtoFrame(1));
  v1::QueryPointsRequest request;
  request.set_positions_f64(Bytes(std::vector<double>{1e6, 0, 0, 1, 2, 3, -4, -5, -6}));
  v1::QueryPointsResponse response;
  ASSERT_TRUE(Query(request, &response).ok());
  EXPECT_EQ(Values<float>(response.distances_f32()).size(), 3u);
  EXPECT_EQ(response.states_u8().size(), 3u);
  EXPECT_TRUE(response.gradients_f32().empty());
  EXPECT_TRUE(response.object_ids_u32().empty());
  EXPECT_TRUE(response.sigmas_f32().empty());
  EXPECT_EQ(response.stamp().revision(), 1u);
  EXPECT_EQ(response.stamp().stamp_ns(), 100'000'000);
  EXPECT_EQ(response.reference_ns(), 100'000'000);
  EXPECT_GE(response.stamp().staleness_s(), 0);
  EXPECT_NE(response.stamp().epoch(), 0u);
  for (const float d : Values<float>(response.distances_f32())) EXPECT_EQ(d, 5.0f);
  request.set_gradients(true);
  request.set_objects(true);
  request.set_sigmas(true);
  request.set_unknown_distances(true);
  ASSERT_TRUE(Query(request, &response).ok());
  EXPECT_EQ(response.gradients_f32().size(), 36u);
  EXPECT_EQ(response.object_ids_u32().size(), 12u);
  EXPECT_EQ(response.sigmas_f32().size(), 12u);
  EXPECT_EQ(response.unknown_distances_f32().size(), 12u);
}

TEST_F(QueryServiceTest, LargeBatchesFitAndAreAnsweredInFull) {
  StartServer();
  v1::QueryPointsRequest request;
  request.set_positions_f32(std::string(100'000 * 12, 0));
  request.set_gradients(true);
  request.set_objects(true);
  request.set_sigmas(true);
  v1::QueryPointsResponse response;
  ASSERT_TRUE(Query(request, &response).ok());
  EXPECT_EQ(response.states_u8().size(), 100'000u);
  EXPECT_LT(response.ByteSizeLong(), 4u << 20);
}

TEST_F(QueryServiceTest, WaitsForARevisionWithoutHoldingUpOthers) {
  StartServer();
  v1::QueryPointsRequest request = OnePoint();
  request.mutable_consistency()->set_min_revision(2);
  request.mutable_consistency()->set_wait_s(60);
  std::vector<std::thread> waiters;
  std::atomic<int> answered = 0;
  for (int i = 0; i < 20; ++i) {
    waiters.emplace_back([&] {
      v1::QueryPointsResponse response;
      EXPECT_TRUE(Query(request, &response).ok());
      EXPECT_EQ(response.stamp().revision(), 2u);
      ++answered;
    });
  }
  EXPECT_EQ(Ingest(ProtoFrame(1)).stamp().revision(), 1u);
  EXPECT_EQ(Revision(), 1u) << "twenty waiting calls hold no thread";
  EXPECT_EQ(answered, 0);
  Ingest(ProtoFrame(2));
  for (std::thread& waiter : waiters) waiter.join();
}

TEST_F(QueryServiceTest, TheClientsDeadlineEndsAWait) {
  StartServer();
  v1::QueryPointsRequest request = OnePoint();
  request.mutable_consistency()->set_min_revision(1);
  request.mutable_consistency()->set_wait_s(60);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(50));
  v1::QueryPointsResponse response;
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(query_->QueryPoints(&context, request, &response).error_code(),
            Code::DEADLINE_EXCEEDED);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(30));
}

TEST_F(QueryServiceTest, AClientThatCancelsIsForgotten) {
  StartServer();
  v1::QueryPointsRequest request = OnePoint();
  request.mutable_consistency()->set_min_revision(1);
  request.mutable_consistency()->set_wait_s(60);
  grpc::ClientContext context;
  std::thread canceller([&] { context.TryCancel(); });
  v1::QueryPointsResponse response;
  EXPECT_EQ(query_->QueryPoints(&context, request, &response).error_code(), Code::CANCELLED);
  canceller.join();
  EXPECT_EQ(Ingest(ProtoFrame(1)).stamp().revision(), 1u);
  EXPECT_EQ(Revision(), 1u);
}

TEST_F(QueryServiceTest, ADrainEndsWaitsWithUnavailable) {
  StartServer();
  std::thread waiter([&] {
    v1::QueryPointsRequest request = OnePoint();
    request.mutable_consistency()->set_min_revision(1);
    request.mutable_consistency()->set_wait_s(60);
    v1::QueryPointsResponse response;
    EXPECT_EQ(Query(request, &response).error_code(), Code::UNAVAILABLE);
  });
  EXPECT_TRUE(server_->Drain());
  waiter.join();
}

TEST_F(QueryServiceTest, ListsNoObjectsAndSlicesNothingOfAnEmptyMap) {
  StartServer();
  grpc::ClientContext list_context, slice_context, bad_context;
  v1::ListObjectsResponse objects;
  ASSERT_TRUE(query_->ListObjects(&list_context, {}, &objects).ok());
  EXPECT_EQ(objects.objects_size(), 0);
  v1::GetSliceResponse slice;
  ASSERT_TRUE(query_->GetSlice(&slice_context, {}, &slice).ok());
  EXPECT_EQ(slice.columns(), 0u);
  v1::GetSliceRequest request;
  request.mutable_bounds()->mutable_max()->set_x_m(1000);
  request.mutable_bounds()->mutable_max()->set_y_m(1000);
  request.set_resolution_m(0.1);
  const grpc::Status status = query_->GetSlice(&bad_context, request, &slice);
  EXPECT_EQ(status.error_code(), Code::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("400000"));
}

TEST_F(QueryServiceTest, ASliceLiesWhereItsReplySays) {
  StartServer();
  v1::GetSliceRequest request;
  request.set_z_m(0.5);
  request.mutable_bounds()->mutable_min()->set_x_m(-1);
  request.mutable_bounds()->mutable_min()->set_y_m(2);
  request.mutable_bounds()->mutable_max()->set_x_m(1);
  request.mutable_bounds()->mutable_max()->set_y_m(3);
  request.set_resolution_m(0.25);
  grpc::ClientContext context;
  v1::GetSliceResponse slice;
  ASSERT_TRUE(query_->GetSlice(&context, request, &slice).ok());
  EXPECT_EQ(slice.columns(), 8u);
  EXPECT_EQ(slice.rows(), 4u);
  EXPECT_DOUBLE_EQ(slice.origin().x_m(), -0.875);
  EXPECT_DOUBLE_EQ(slice.origin().y_m(), 2.125);
  EXPECT_DOUBLE_EQ(slice.origin().z_m(), 0.5);
  EXPECT_EQ(Values<float>(slice.distances_f32()).size(), 32u);
  EXPECT_EQ(slice.states_u8().size(), 32u);
}

TEST_F(QueryServiceTest, WhatIsNotOfferedYetSaysSo) {
  StartServer();
  const auto expect = [](const grpc::Status& status, const char* method) {
    EXPECT_EQ(status.error_code(), Code::UNIMPLEMENTED) << method;
    EXPECT_THAT(status.error_message(), HasSubstr(method));
  };
  grpc::ClientContext context;
  v1::RepositionSubmapsResponse submaps;
  expect(map_->RepositionSubmaps(&context, {}, &submaps), "RepositionSubmaps");
}

}  // namespace
}  // namespace clearance
