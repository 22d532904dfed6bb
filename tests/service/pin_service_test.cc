// PinRevision and ReleasePin: what stays answerable, for how long, how many.
#include <thread>

#include "clearance/v1/query.pb.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

class PinServiceTest : public ServiceFixture {
 protected:
  grpc::Status Pin(const v1::PinRevisionRequest& request, v1::PinRevisionResponse* response) {
    grpc::ClientContext context;
    return query_->PinRevision(&context, request, response);
  }
  grpc::Status Release(uint64_t pin_id) {
    grpc::ClientContext context;
    v1::ReleasePinRequest request;
    request.set_pin_id(pin_id);
    v1::ReleasePinResponse response;
    return query_->ReleasePin(&context, request, &response);
  }
  grpc::Status QueryPin(uint64_t pin_id, v1::QueryPointsResponse* response,
                        uint64_t min_revision = 0) {
    v1::QueryPointsRequest request = OnePoint();
    request.mutable_consistency()->set_pin_id(pin_id);
    request.mutable_consistency()->set_min_revision(min_revision);
    return Query(request, response);
  }
  uint64_t CountedPins() {
    grpc::ClientContext context;
    v1::GetStatsResponse stats;
    EXPECT_TRUE(admin_->GetStats(&context, {}, &stats).ok());
    return stats.maps(0).pins();
  }
};

TEST_F(PinServiceTest, APinnedRevisionIsAnsweredAfterManyOthers) {
  StartServer();
  Ingest(ProtoFrame(1));
  v1::PinRevisionResponse pin;
  ASSERT_TRUE(Pin({}, &pin).ok());
  EXPECT_EQ(pin.stamp().revision(), 1u);
  EXPECT_EQ(pin.ttl_s(), 10);
  for (uint64_t id = 2; id <= 30; ++id) Ingest(ProtoFrame(id));
  v1::QueryPointsResponse response;
  ASSERT_TRUE(QueryPin(pin.pin_id(), &response).ok());
  EXPECT_EQ(response.stamp().revision(), 1u);
  EXPECT_EQ(response.stamp().stamp_ns(), 100'000'000);
  EXPECT_EQ(Revision(), 30u);
  EXPECT_EQ(CountedPins(), 1u);
  // Its field will never reach a later revision.
  const grpc::Status later = QueryPin(pin.pin_id(), &response, 2);
  EXPECT_EQ(later.error_code(), Code::ABORTED);
  EXPECT_THAT(later.error_message(), HasSubstr("min_revision"));
  ASSERT_TRUE(Release(pin.pin_id()).ok());
  EXPECT_EQ(CountedPins(), 0u);
  const grpc::Status gone = QueryPin(pin.pin_id(), &response);
  EXPECT_EQ(gone.error_code(), Code::NOT_FOUND);
  EXPECT_THAT(gone.error_message(), HasSubstr("Pins: none"));
  EXPECT_EQ(Release(pin.pin_id()).error_code(), Code::NOT_FOUND);
}

TEST_F(PinServiceTest, AnEarlierRevisionCanBePinnedWhileItIsKept) {
  StartServer();
  for (uint64_t id = 1; id <= 20; ++id) Ingest(ProtoFrame(id));
  v1::PinRevisionRequest request;
  request.set_revision(18);
  v1::PinRevisionResponse pin;
  ASSERT_TRUE(Pin(request, &pin).ok());
  EXPECT_EQ(pin.stamp().revision(), 18u);
  request.set_revision(2);
  const grpc::Status status = Pin(request, &pin);
  EXPECT_EQ(status.error_code(), Code::OUT_OF_RANGE);
  EXPECT_THAT(status.error_message(), HasSubstr("revision 2"));
  request.set_revision(99);
  EXPECT_EQ(Pin(request, &pin).error_code(), Code::OUT_OF_RANGE);
}

TEST_F(PinServiceTest, PinsEndByThemselves) {
  StartServer();
  v1::PinRevisionRequest request;
  request.set_ttl_s(0.05);
  v1::PinRevisionResponse pin;
  ASSERT_TRUE(Pin(request, &pin).ok());
  EXPECT_EQ(pin.ttl_s(), 0.05);
  while (CountedPins() > 0) std::this_thread::yield();
  v1::QueryPointsResponse response;
  EXPECT_EQ(QueryPin(pin.pin_id(), &response).error_code(), Code::NOT_FOUND);
  request.set_ttl_s(1e9);
  ASSERT_TRUE(Pin(request, &pin).ok());
  EXPECT_EQ(pin.ttl_s(), 120) << "no pin lives for ever";
  request.set_ttl_s(-1);
  EXPECT_EQ(Pin(request, &pin).error_code(), Code::INVALID_ARGUMENT);
  request.set_ttl_s(NAN);
  EXPECT_EQ(Pin(request, &pin).error_code(), Code::INVALID_ARGUMENT);
}

TEST_F(PinServiceTest, TooManyPinsAreRefusedWithATimeToTryAgain) {
  ServerOptions options;
  options.limits.pins.max_pins = 3;
  StartServer({}, options);
  v1::PinRevisionResponse pin;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(Pin({}, &pin).ok());
  const grpc::Status status = Pin({}, &pin);
  EXPECT_EQ(status.error_code(), Code::RESOURCE_EXHAUSTED);
  EXPECT_THAT(status.error_message(), HasSubstr("limit 3"));
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(status.error_details()));
  google::rpc::RetryInfo retry;
  ASSERT_TRUE(details.details(0).UnpackTo(&retry));
  EXPECT_GT(retry.retry_delay().seconds(), 5);
  ASSERT_TRUE(Release(pin.pin_id()).ok());
  EXPECT_TRUE(Pin({}, &pin).ok());
}

TEST_F(PinServiceTest, PinsBelongToOneMapInOneEpoch) {
  StartServer();
  v1::PinRevisionResponse pin;
  ASSERT_TRUE(Pin({}, &pin).ok());
  ASSERT_TRUE(registry_->Create("yard", {}).ok());
  v1::QueryPointsRequest request = OnePoint();
  request.set_map("yard");
  request.mutable_consistency()->set_pin_id(pin.pin_id());
  v1::QueryPointsResponse response;
  EXPECT_EQ(Query(request, &response).error_code(), Code::NOT_FOUND);
  ASSERT_TRUE(registry_->Delete("default").ok());
  ASSERT_TRUE(registry_->Create("default", {}).ok());
  EXPECT_EQ(QueryPin(pin.pin_id(), &response).error_code(), Code::NOT_FOUND);
}

}  // namespace
}  // namespace clearance
