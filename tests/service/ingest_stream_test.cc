#include <chrono>
#include <future>
#include <thread>

#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class IngestStreamTest : public ServiceFixture {};

TEST_F(IngestStreamTest, AcksEveryFrameWithItsRevisionAndGivesTheCreditBack) {
  StartServer();
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  EXPECT_FALSE(client.opened().has_last_frame_id());
  EXPECT_GE(client.opened().credits().frames(), 1u);
  EXPECT_GE(client.opened().limits().max_points(), 1'000'000u);
  for (uint64_t id = 1; id <= 50; ++id) {
    ASSERT_TRUE(client.Send(ProtoFrame(id)));
    const v1::FrameAck ack = client.ReadAck();
    EXPECT_EQ(ack.frame_id(), id);
    EXPECT_EQ(ack.status(), v1::INGEST_STATUS_INTEGRATED);
    EXPECT_EQ(ack.stamp().revision(), id);
  }
  EXPECT_TRUE(client.Finish().ok());
  EXPECT_EQ(Revision(), 50u);
}

TEST_F(IngestStreamTest, HalfCloseSettlesWhatIsInFlightFirst) {
  Gate gate;
  StartServer(Held(&gate));
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  for (uint64_t id = 1; id <= 4; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id)));
  gate.WaitForArrival();
  std::thread opener([&] { gate.Open(); });
  EXPECT_TRUE(client.Finish().ok());
  opener.join();
  EXPECT_EQ(client.late_acks().size(), 4u);
}

TEST_F(IngestStreamTest, ResumesBehindTheLastSettledFrame) {
  StartServer();
  {
    IngestClient client(ingest_.get());
    ASSERT_TRUE(client.Open("", "lidar"));
    for (uint64_t id = 1; id <= 3; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id)));
    EXPECT_TRUE(client.Finish().ok());
  }
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open("", "lidar"));
  EXPECT_EQ(client.opened().last_frame_id(), 3u);
  ASSERT_TRUE(client.Send(ProtoFrame(3)));
  const v1::FrameAck repeat = client.ReadAck();
  EXPECT_EQ(repeat.status(), v1::INGEST_STATUS_DUPLICATE);
  EXPECT_EQ(repeat.stamp().revision(), 3u);
  ASSERT_TRUE(client.Send(ProtoFrame(4)));
  EXPECT_EQ(client.ReadAck().stamp().revision(), 4u);
  EXPECT_TRUE(client.Finish().ok());
  EXPECT_THAT(log_->integrated, ElementsAre(1, 2, 3, 4));
}

TEST_F(IngestStreamTest, ACutStreamLosesNothingThatWasReceived) {
  Gate gate;
  StartServer(Held(&gate));
  {
    IngestClient client(ingest_.get());
    ASSERT_TRUE(client.Open());
    ASSERT_TRUE(client.Send(ProtoFrame(1)));
    gate.WaitForArrival();
    client.Cancel();
    client.Drain();
  }
  gate.Open();
  // The source is free again as soon as the server has noticed.
  for (int attempt = 0;; ++attempt) {
    IngestClient client(ingest_.get());
    if (client.Open()) {
      ASSERT_TRUE(client.Send(ProtoFrame(1)));
      EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_DUPLICATE);
      EXPECT_TRUE(client.Finish().ok());
      break;
    }
    ASSERT_LT(attempt, 10'000);
    EXPECT_EQ(client.Drain().error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  }
  EXPECT_THAT(log_->integrated, ElementsAre(1));
}

TEST_F(IngestStreamTest, RefusesASecondStreamOfOneSourceOnly) {
  StartServer();
  IngestClient first(ingest_.get());
  ASSERT_TRUE(first.Open("", "a"));
  IngestClient second(ingest_.get());
  EXPECT_FALSE(second.Open("", "a"));
  const grpc::Status status = second.Drain();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(status.error_message(), HasSubstr("'a'"));
  IngestClient third(ingest_.get());
  EXPECT_TRUE(third.Open("", "b"));
  EXPECT_TRUE(first.Finish().ok());
  IngestClient again(ingest_.get());
  EXPECT_TRUE(again.Open("", "a"));
}

TEST_F(IngestStreamTest, AStreamThatDoesNotOpenWellEndsAndSaysWhy) {
  StartServer();
  const auto status_of = [&](const v1::IngestFramesRequest& request) {
    IngestClient client(ingest_.get());
    client.Write(request);
    return client.Drain();
  };
  v1::IngestFramesRequest request;
  EXPECT_EQ(status_of(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  *request.mutable_frame() = ProtoFrame(1);
  EXPECT_THAT(status_of(request).error_message(), HasSubstr("open"));
  request.mutable_open()->set_map("nowhere");
  EXPECT_EQ(status_of(request).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_THAT(status_of(request).error_message(), HasSubstr("Maps: default"));
  request.mutable_open()->set_map("No Where");
  EXPECT_EQ(status_of(request).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  request.mutable_open()->set_map("");
  request.mutable_open()->set_source_id("Bad Source");
  EXPECT_THAT(status_of(request).error_message(), HasSubstr("open.source_id"));
  request.mutable_open()->set_source_id("");
  for (const double range : {-1.0, std::nan(""), HUGE_VAL}) {
    request.mutable_open()->set_max_range_m(range);
    EXPECT_THAT(status_of(request).error_message(), HasSubstr("open.max_range_m"));
  }
}

TEST_F(IngestStreamTest, ASecondOpenEndsTheStreamAfterItsAcks) {
  StartServer();
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  ASSERT_TRUE(client.Send(ProtoFrame(1)));
  v1::IngestFramesRequest again;
  again.mutable_open();
  client.Write(again);
  EXPECT_EQ(client.Drain().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(client.late_acks().size(), 1u);
}

TEST_F(IngestStreamTest, ExceedingTheCreditsEndsTheStreamAndKeepsWhatWasInFlight) {
  Gate gate;
  ServerOptions options;
  options.limits.credits = 2;
  StartServer(Held(&gate), options);
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  EXPECT_EQ(client.opened().credits().frames(), 2u);
  for (uint64_t id = 1; id <= 3; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id)));
  gate.Open();
  const grpc::Status status = client.Drain();
  // Frame 3 is one too many, unless frame 1 was acked before it came.
  if (!status.ok()) {
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_THAT(status.error_message(), HasSubstr("frame 3"));
    EXPECT_EQ(client.late_acks().size(), 2u);
  }
}

TEST_F(IngestStreamTest, AFullQueueHoldsTheStreamBackWithoutLoss) {
  Gate gate;
  RegistryOptions registry = Held(&gate);
  registry.engine.queue_frames = 1;
  ServerOptions options;
  options.limits.credits = 8;
  StartServer(std::move(registry), options);
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  // In process a write waits until it is read.
  std::thread sender([&] {
    for (uint64_t id = 1; id <= 8; ++id) EXPECT_TRUE(client.Send(ProtoFrame(id)));
  });
  gate.WaitForArrival();
  // The unary twin is refused instead, and told to try again.
  grpc::ClientContext context;
  v1::IngestFrameRequest request;
  request.set_source_id("other");
  *request.mutable_frame() = ProtoFrame(1);
  v1::IngestFrameResponse response;
  while (registry_->List()[0]->Stats().queue_length < 1) std::this_thread::yield();
  const grpc::Status refused = ingest_->IngestFrame(&context, request, &response);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_FALSE(refused.error_details().empty()) << "RetryInfo";
  gate.Open();
  sender.join();
  EXPECT_TRUE(client.Finish().ok());
  ASSERT_EQ(client.late_acks().size(), 8u);
  for (const v1::FrameAck& ack : client.late_acks()) {
    EXPECT_EQ(ack.status(), v1::INGEST_STATUS_INTEGRATED);
  }
}

TEST_F(IngestStreamTest, QueriesAndHealthAnswerWhileOneIntegrationTakesTwoSeconds) {
  using std::chrono::steady_clock;
  std::promise<void> started;
  std::atomic<bool> running = false;
  RegistryOptions registry;
  registry.engine.before_integrate = [&](const Frame& frame) {
    if (frame.frame_id != 2) return;
    running = true;
    started.set_value();
    std::this_thread::sleep_for(std::chrono::seconds(2));
    running = false;
  };
  StartServer(std::move(registry));
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  ASSERT_TRUE(client.Send(ProtoFrame(1)));
  EXPECT_EQ(client.ReadAck().stamp().revision(), 1u);
  ASSERT_TRUE(client.Send(ProtoFrame(2)));
  started.get_future().wait();
  int answered = 0;
  while (true) {
    const uint64_t revision = Revision();
    grpc::ClientContext context;
    grpc::health::v1::HealthCheckRequest request;
    grpc::health::v1::HealthCheckResponse response;
    ASSERT_TRUE(health_->Check(&context, request, &response).ok());
    v1::GetMapRequest get;
    v1::GetMapResponse got;
    grpc::ClientContext get_context;
    ASSERT_TRUE(map_->GetMap(&get_context, get, &got).ok());
    if (!running) break;
    EXPECT_EQ(revision, 1u);
    EXPECT_EQ(response.status(), grpc::health::v1::HealthCheckResponse::SERVING);
    ++answered;
  }
  EXPECT_GE(answered, 10);
  EXPECT_EQ(client.ReadAck().stamp().revision(), 2u);
}

TEST_F(IngestStreamTest, DrainFlushesAcksAndSaysWhereToResume) {
  Gate gate;
  StartServer(Held(&gate));
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  for (uint64_t id = 1; id <= 3; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id)));
  gate.WaitForArrival();
  while (registry_->List()[0]->Stats().queue_length < 2) std::this_thread::yield();
  std::thread drain([&] { EXPECT_TRUE(server_->Drain()); });
  while (!server_->context().draining) std::this_thread::yield();
  // New work is refused at once, before the drain is over.
  v1::QueryPointsResponse response;
  EXPECT_EQ(Query(OnePoint(), &response).error_code(), grpc::StatusCode::UNAVAILABLE);
  gate.Open();
  const grpc::Status status = client.Drain();
  drain.join();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(client.late_acks().size(), 3u);
  ASSERT_TRUE(client.closing());
  EXPECT_EQ(client.closing()->reason(), v1::INGEST_CLOSING_REASON_DRAINING);
  EXPECT_EQ(client.closing()->last_frame_id(), 3u);
}

TEST_F(IngestStreamTest, ADrainThatRunsOutOfTimeLeavesFramesUnsettled) {
  Gate gate;
  ServerOptions options;
  options.drain_timeout = std::chrono::milliseconds(1);
  StartServer(Held(&gate), options);
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open());
  for (uint64_t id = 1; id <= 3; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id)));
  gate.WaitForArrival();
  while (registry_->List()[0]->Stats().queue_length < 2) std::this_thread::yield();
  std::promise<bool> drained;
  std::thread drain([&] { drained.set_value(server_->Drain()); });
  // Once the engine refuses tasks it is stopping, and abandons what waits.
  while (!absl::IsUnavailable(registry_->List()[0]->Post([](MapModel*, const ViewPtr&) {}))) {
    std::this_thread::yield();
  }
  gate.Open();
  client.Drain();
  drain.join();
  EXPECT_FALSE(drained.get_future().get());
  ASSERT_TRUE(client.closing());
  EXPECT_EQ(client.closing()->last_frame_id(), 1u);
  EXPECT_EQ(client.late_acks().size(), 1u);
}

TEST_F(IngestStreamTest, DeletingTheMapClosesItsStreams) {
  StartServer();
  ASSERT_TRUE(registry_->Create("yard", {}).ok());
  IngestClient client(ingest_.get());
  ASSERT_TRUE(client.Open("yard"));
  ASSERT_TRUE(client.Send(ProtoFrame(1)));
  EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_INTEGRATED);
  grpc::ClientContext context;
  v1::DeleteMapRequest request;
  request.set_map("yard");
  v1::DeleteMapResponse response;
  ASSERT_TRUE(map_->DeleteMap(&context, request, &response).ok());
  EXPECT_EQ(response.stamp().revision(), 1u);
  EXPECT_EQ(client.Drain().error_code(), grpc::StatusCode::NOT_FOUND);
  ASSERT_TRUE(client.closing());
  EXPECT_EQ(client.closing()->reason(), v1::INGEST_CLOSING_REASON_DELETED);
  EXPECT_EQ(client.closing()->last_frame_id(), 1u);
}

TEST_F(IngestStreamTest, TwoMapsTakeFramesSideBySide) {
  StartServer();
  ASSERT_TRUE(registry_->Create("yard", {}).ok());
  IngestClient a(ingest_.get()), b(ingest_.get());
  ASSERT_TRUE(a.Open("default", "cam"));
  ASSERT_TRUE(b.Open("yard", "cam"));
  for (uint64_t id = 1; id <= 5; ++id) {
    ASSERT_TRUE(a.Send(ProtoFrame(id)));
    if (id <= 2) {
      ASSERT_TRUE(b.Send(ProtoFrame(id + 40)));
    }
  }
  EXPECT_TRUE(a.Finish().ok());
  EXPECT_TRUE(b.Finish().ok());
  EXPECT_EQ(Revision(), 5u);
  EXPECT_EQ(Revision("yard"), 2u);
}

}  // namespace
}  // namespace clearance
