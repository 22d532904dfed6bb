// QueryStream: tags, pipelining, errors as replies, slow readers, cancellation, drain.
#include <set>
#include <thread>

#include "clearance/v1/query.pb.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

class QueryStreamTest : public ServiceFixture {
 protected:
  using Stream = grpc::ClientReaderWriter<v1::QueryStreamRequest, v1::QueryStreamResponse>;

  static v1::QueryStreamRequest Points(uint64_t tag) {
    v1::QueryStreamRequest request;
    request.set_tag(tag);
    *request.mutable_query_points() = OnePoint(static_cast<float>(tag));
    return request;
  }
  static v1::QueryStreamRequest Waiting(uint64_t tag, uint64_t min_revision) {
    v1::QueryStreamRequest request = Points(tag);
    request.mutable_query_points()->mutable_consistency()->set_min_revision(min_revision);
    request.mutable_query_points()->mutable_consistency()->set_wait_s(60);
    return request;
  }
  void AwaitNoOpenStreams() {
    while (server_->context().open_streams > 0) std::this_thread::yield();
  }
};

TEST_F(QueryStreamTest, AnswersEveryKindOfRequestUnderItsTag) {
  StartServer();
  Ingest(ProtoFrame(1));
  grpc::ClientContext context;
  auto stream = query_->QueryStream(&context);
  ASSERT_TRUE(stream->Write(Points(11)));
  v1::QueryStreamRequest request;
  request.set_tag(12);
  request.mutable_check_trajectories()->set_spheres_f32(Bytes(std::vector<float>{0, 0, 0, 1}));
  v1::Trajectory* trajectory = request.mutable_check_trajectories()->add_trajectories();
  trajectory->set_waypoints_f64(Bytes(std::vector<double>{0, 0, 0, 0, 0, 0, 1}));
  trajectory->set_times_f64(Bytes(std::vector<double>{0}));
  ASSERT_TRUE(stream->Write(request));
  request.set_tag(13);
  request.mutable_check_spheres()->set_spheres_f32(Bytes(std::vector<float>{0, 0, 0, 1}));
  request.mutable_check_spheres()->set_poses_f64(Bytes(std::vector<double>{0, 0, 0, 0, 0, 0, 1}));
  ASSERT_TRUE(stream->Write(request));
  request.set_tag(14);
  request.mutable_list_objects();
  ASSERT_TRUE(stream->Write(request));
  request.set_tag(15);
  request.mutable_get_slice();
  ASSERT_TRUE(stream->Write(request));
  stream->WritesDone();
  std::map<uint64_t, int> kinds;
  v1::QueryStreamResponse response;
  while (stream->Read(&response)) kinds[response.tag()] = response.response_case();
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(kinds, (std::map<uint64_t, int>{{11, v1::QueryStreamResponse::kQueryPoints},
                                            {12, v1::QueryStreamResponse::kCheckTrajectories},
                                            {13, v1::QueryStreamResponse::kCheckSpheres},
                                            {14, v1::QueryStreamResponse::kListObjects},
                                            {15, v1::QueryStreamResponse::kGetSlice}}));
}

TEST_F(QueryStreamTest, AnErrorIsAReplyAndTheStreamLives) {
  StartServer();
  grpc::ClientContext context;
  auto stream = query_->QueryStream(&context);
  v1::QueryStreamResponse response;
  v1::QueryStreamRequest bad = Points(1);
  bad.mutable_query_points()->set_positions_f32(std::string(13, 'x'));
  ASSERT_TRUE(stream->Write(bad));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.tag(), 1u);
  EXPECT_EQ(response.error().code(), static_cast<int>(Code::INVALID_ARGUMENT));
  EXPECT_THAT(response.error().message(), HasSubstr("13"));
  ASSERT_EQ(response.error().violations_size(), 1);
  EXPECT_EQ(response.error().violations(0).field(), "positions_f32");
  bad = Points(2);
  bad.mutable_query_points()->set_map("yard");
  ASSERT_TRUE(stream->Write(bad));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.error().code(), static_cast<int>(Code::NOT_FOUND));
  v1::QueryStreamRequest nothing;
  nothing.set_tag(3);
  ASSERT_TRUE(stream->Write(nothing));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.tag(), 3u);
  EXPECT_EQ(response.error().code(), static_cast<int>(Code::INVALID_ARGUMENT));
  ASSERT_TRUE(stream->Write(Points(4)));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_TRUE(response.has_query_points());
  stream->WritesDone();
  EXPECT_FALSE(stream->Read(&response));
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(QueryStreamTest, QuickAnswersOvertakeThoseThatWait) {
  StartServer();
  grpc::ClientContext context;
  auto stream = query_->QueryStream(&context);
  ASSERT_TRUE(stream->Write(Waiting(1, 1)));
  v1::QueryStreamResponse response;
  for (uint64_t tag = 2; tag < 100; ++tag) {
    ASSERT_TRUE(stream->Write(Points(tag)));
    ASSERT_TRUE(stream->Read(&response));
    EXPECT_EQ(response.tag(), tag);
  }
  Ingest(ProtoFrame(1));
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.tag(), 1u);
  EXPECT_EQ(response.query_points().stamp().revision(), 1u);
  stream->WritesDone();
  EXPECT_TRUE(stream->Finish().ok());
}

TEST_F(QueryStreamTest, ASlowReaderHoldsTheServerToItsBound) {
  ServerOptions options;
  options.limits.max_stream_requests = 4;
  StartServer({}, options);
  grpc::ClientContext context;
  auto stream = query_->QueryStream(&context);
  // Every one waits, so that not one can be answered before the frame.
  constexpr uint64_t kRequests = 200;
  std::thread writer([&] {
    for (uint64_t tag = 1; tag <= kRequests; ++tag) stream->Write(Waiting(tag, 1));
    stream->WritesDone();
  });
  Ingest(ProtoFrame(1));
  std::set<uint64_t> tags;
  v1::QueryStreamResponse response;
  while (stream->Read(&response)) {
    EXPECT_TRUE(response.has_query_points());
    tags.insert(response.tag());
  }
  writer.join();
  EXPECT_TRUE(stream->Finish().ok());
  EXPECT_EQ(tags.size(), kRequests);
}

TEST_F(QueryStreamTest, ACancelledStreamForgetsWhatWaited) {
  StartServer();
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    auto stream = query_->QueryStream(&context);
    for (uint64_t tag = 1; tag <= 10; ++tag) ASSERT_TRUE(stream->Write(Waiting(tag, 1)));
    v1::QueryStreamResponse response;
    ASSERT_TRUE(stream->Write(Points(99)));
    ASSERT_TRUE(stream->Read(&response));
    EXPECT_EQ(response.tag(), 99u);
    context.TryCancel();
    EXPECT_FALSE(stream->Read(&response));
    EXPECT_EQ(stream->Finish().error_code(), Code::CANCELLED);
  }
  AwaitNoOpenStreams();
  EXPECT_EQ(Ingest(ProtoFrame(1)).stamp().revision(), 1u);
}

TEST_F(QueryStreamTest, ADrainEndsOpenStreams) {
  ServerOptions options;
  options.socket = SocketPath();
  StartServer({}, options);
  grpc::ClientContext idle_context, waiting_context;
  auto idle = query_->QueryStream(&idle_context);
  auto waiting = query_->QueryStream(&waiting_context);
  v1::QueryStreamResponse response;
  ASSERT_TRUE(idle->Write(Points(1)));
  ASSERT_TRUE(idle->Read(&response));
  ASSERT_TRUE(waiting->Write(Waiting(7, 1)));
  ASSERT_TRUE(waiting->Write(Points(8)));
  ASSERT_TRUE(waiting->Read(&response));
  EXPECT_TRUE(server_->Drain());
  EXPECT_FALSE(idle->Read(&response));
  EXPECT_EQ(idle->Finish().error_code(), Code::UNAVAILABLE);
  // What waited is answered, then the stream ends.
  ASSERT_TRUE(waiting->Read(&response));
  EXPECT_EQ(response.tag(), 7u);
  EXPECT_EQ(response.error().code(), static_cast<int>(Code::UNAVAILABLE));
  EXPECT_FALSE(waiting->Read(&response));
  EXPECT_EQ(waiting->Finish().error_code(), Code::UNAVAILABLE);
}

}  // namespace
}  // namespace clearance
