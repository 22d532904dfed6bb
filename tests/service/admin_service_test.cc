// Drain by call.
#include <cmath>

#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

class AdminService : public ServiceFixture {
 protected:
  grpc::Status Drain(double timeout_s, v1::DrainResponse* response) {
    grpc::ClientContext context;
    v1::DrainRequest request;
    request.set_timeout_s(timeout_s);
    return admin_->Drain(&context, request, response);
  }
  bool Serving() {
    grpc::ClientContext context;
    grpc::health::v1::HealthCheckResponse response;
    EXPECT_TRUE(health_->Check(&context, {}, &response).ok());
    return response.status() == grpc::health::v1::HealthCheckResponse::SERVING;
  }
};

TEST_F(AdminService, DrainSettlesWhatWaitsAndRefusesTheRest) {
  Gate gate;
  StartServer(Held(&gate));
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  for (uint64_t id = 1; id <= 3; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id)));
  gate.WaitForArrival();
  v1::DrainResponse drained;
  EXPECT_EQ(Drain(0.05, &drained).error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_FALSE(Serving());
  gate.Open();
  ASSERT_TRUE(Drain(60, &drained).ok());
  client.Drain();
  ASSERT_TRUE(client.closing());
  const uint64_t last = client.closing()->last_frame_id();
  EXPECT_EQ(client.late_acks().size(), last);  // every frame it took was acknowledged
  v1::QueryPointsResponse response;
  EXPECT_EQ(Query(OnePoint(), &response).error_code(), grpc::StatusCode::UNAVAILABLE);
}

TEST_F(AdminService, DrainNamesABadTimeout) {
  StartServer();
  v1::DrainResponse drained;
  for (const double timeout_s : {-1.0, 1e9, std::nan("")}) {
    const grpc::Status status = Drain(timeout_s, &drained);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
    EXPECT_THAT(status.error_message(), ::testing::HasSubstr("timeout_s"));
  }
  EXPECT_TRUE(Serving());
}

}  // namespace
}  // namespace clearance
