#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"
#include "proto/wire/grpc_status.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

TEST(WireStatus, CodeTextAndDetailsCrossTheWire) {
  const absl::Status status = WithRetry(absl::ResourceExhaustedError("queue of map yard is full"),
                                        absl::Milliseconds(1250));
  const grpc::Status sent = ToGrpcStatus(status);
  EXPECT_EQ(sent.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  const absl::Status received = FromGrpcStatus(sent);
  EXPECT_EQ(received, status);
  EXPECT_EQ(RetryDelayOf(received), absl::Milliseconds(1250));
  EXPECT_EQ(RetryDelayOf(absl::InternalError("x")), std::nullopt);
}

TEST(WireStatus, OtherClientsReadTheDetailsAsGoogleRpcStatus) {
  const grpc::Status sent = ToGrpcStatus(InvalidField("positions_f32", 417, "nan", "finite"));
  google::rpc::Status details;
  ASSERT_TRUE(details.ParseFromString(sent.error_details()));
  EXPECT_EQ(details.code(), 3);
  ASSERT_EQ(details.details_size(), 1);
  google::rpc::BadRequest bad;
  ASSERT_TRUE(details.details(0).UnpackTo(&bad));
  EXPECT_EQ(bad.field_violations(0).field(), "positions_f32[417]");
  EXPECT_EQ(bad.field_violations(0).description(), "got nan; expected finite");
}

TEST(WireStatus, AllOkStaysOk) {
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
  EXPECT_TRUE(FromGrpcStatus(grpc::Status::OK).ok());
  EXPECT_TRUE(ViolationsOf(absl::OkStatus()).empty());
}

TEST(WireStatus, HugeTextsAreCutBelowTheMetadataLimit) {
  const grpc::Status sent =
      ToGrpcStatus(InvalidField("map", -1, std::string(100'000, 'x'), "a name"));
  EXPECT_LE(sent.error_message().size() + sent.error_details().size(), 7000u);
}

TEST(WireStatus, AStatusWithoutDetailsIsOneViolation) {
  const auto violations = ViolationsOf(absl::InvalidArgumentError("motions are odd"));
  ASSERT_EQ(violations.size(), 1u);
  EXPECT_EQ(violations[0].description, "motions are odd");
  EXPECT_EQ(violations[0].index, -1);
}

}  // namespace
}  // namespace clearance::wire
