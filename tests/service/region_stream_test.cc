// GetRegion: dense blocks, one at a time, cancelled, drained, read slowly.
#include <thread>

#include "clearance/v1/query.pb.h"
#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;
using Code = grpc::StatusCode;

class RegionStreamTest : public ServiceFixture {
 protected:
  static v1::GetRegionRequest Box(double x, double y, double z, double resolution_m) {
    v1::GetRegionRequest request;
    v1::Point* min = request.mutable_bounds()->mutable_min();
    min->set_x_m(-1);
    min->set_y_m(-2);
    min->set_z_m(-3);
    v1::Point* max = request.mutable_bounds()->mutable_max();
    max->set_x_m(-1 + x);
    max->set_y_m(-2 + y);
    max->set_z_m(-3 + z);
    request.set_resolution_m(resolution_m);
    return request;
  }
  void AwaitNoOpenStreams() {
    while (server_->context().open_streams > 0) std::this_thread::yield();
  }
};

TEST_F(RegionStreamTest, BlocksFillTheBoxInOrder) {
  StartServer();
  Ingest(ProtoFrame(1));
  grpc::ClientContext context;
  v1::GetRegionRequest request = Box(7, 3.3, 0.5, 0.1);
  request.set_gradients(true);
  request.set_objects(true);
  auto reader = query_->GetRegion(&context, request);
  size_t cells = 0, blocks = 0;
  std::array<double, 3> last = {-1e9, 0, 0};
  v1::GetRegionResponse block;
  while (reader->Read(&block)) {
    const size_t n = size_t{block.size_x()} * block.size_y() * block.size_z();
    EXPECT_EQ(Values<float>(block.distances_f32()).size(), n);
    EXPECT_EQ(block.states_u8().size(), n);
    EXPECT_EQ(block.gradients_f32().size(), 12 * n);
    EXPECT_EQ(block.object_ids_u32().size(), 4 * n);
    EXPECT_EQ(block.stamp().revision(), 1u);
    const std::array<double, 3> origin = {block.origin().x_m(), block.origin().y_m(),
                                          block.origin().z_m()};
    EXPECT_LT(last, origin);
    if (blocks == 0) {
      EXPECT_DOUBLE_EQ(origin[0], -0.95);
      EXPECT_DOUBLE_EQ(origin[1], -1.95);
      EXPECT_DOUBLE_EQ(origin[2], -2.95);
    }
    last = origin;
    cells += n;
    ++blocks;
  }
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(cells, 70u * 33 * 5);
  EXPECT_EQ(blocks, 3u * 2);
}

TEST_F(RegionStreamTest, UnknownBlocksCanBeLeftOut) {
  StartServer();
  grpc::ClientContext context;
  v1::GetRegionRequest request = Box(7, 3, 0.5, 0.1);
  request.set_known_only(true);
  auto reader = query_->GetRegion(&context, request);
  v1::GetRegionResponse block;
  EXPECT_FALSE(reader->Read(&block)) << "nothing was ever seen";
  EXPECT_TRUE(reader->Finish().ok());
}

TEST_F(RegionStreamTest, BadRegionsAreRefused) {
  StartServer();
  Ingest(ProtoFrame(1));
  const auto expect = [&](v1::GetRegionRequest request, Code code, const char* said) {
    grpc::ClientContext context;
    auto reader = query_->GetRegion(&context, request);
    v1::GetRegionResponse block;
    EXPECT_FALSE(reader->Read(&block));
    const grpc::Status status = reader->Finish();
    EXPECT_EQ(status.error_code(), code) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr(said));
  };
  expect({}, Code::INVALID_ARGUMENT, "bounds");
  expect(Box(-1, 1, 1, 0.1), Code::INVALID_ARGUMENT, "bounds");
  expect(Box(1000, 1000, 1000, 0.1), Code::INVALID_ARGUMENT, "64000000");
  expect(Box(1e300, 1e300, 1, 1e-300), Code::INVALID_ARGUMENT, "64000000");
  expect(Box(NAN, 1, 1, 0.1), Code::INVALID_ARGUMENT, "bounds");
  expect(Box(1, 1, 1, -0.1), Code::INVALID_ARGUMENT, "resolution_m");
  v1::GetRegionRequest request = Box(1, 1, 1, 0.1);
  request.set_horizon_s(9);
  expect(request, Code::OUT_OF_RANGE, "limit 5");
  request = Box(1, 1, 1, 0.1);
  request.set_map("yard");
  expect(request, Code::NOT_FOUND, "yard");
  request = Box(1, 1, 1, 0.1);
  request.mutable_consistency()->set_min_revision(9);
  expect(request, Code::ABORTED, "min_revision");
}

TEST_F(RegionStreamTest, ACancelledOrForsakenReaderEndsTheWork) {
  StartServer();
  for (int i = 0; i < 10; ++i) {
    grpc::ClientContext context;
    auto reader = query_->GetRegion(&context, Box(60, 60, 60, 0.2));
    v1::GetRegionResponse block;
    ASSERT_TRUE(reader->Read(&block));
    context.TryCancel();
    while (reader->Read(&block)) {
    }
    EXPECT_EQ(reader->Finish().error_code(), Code::CANCELLED);
  }
  // One that never reads stops the server after the block that nobody takes.
  grpc::ClientContext slow_context;
  auto slow = query_->GetRegion(&slow_context, Box(60, 60, 60, 0.2));
  EXPECT_EQ(Ingest(ProtoFrame(1)).stamp().revision(), 1u);
  slow_context.TryCancel();
  slow.reset();
  // And one that waits for a revision.
  grpc::ClientContext waiting_context;
  v1::GetRegionRequest request = Box(1, 1, 1, 0.1);
  request.mutable_consistency()->set_min_revision(99);
  request.mutable_consistency()->set_wait_s(60);
  auto waiting = query_->GetRegion(&waiting_context, request);
  waiting_context.TryCancel();
  EXPECT_EQ(waiting->Finish().error_code(), Code::CANCELLED);
  AwaitNoOpenStreams();
}

TEST_F(RegionStreamTest, ADrainEndsAStreamUnderWay) {
  ServerOptions options;
  options.socket = SocketPath();
  StartServer({}, options);
  grpc::ClientContext context;
  auto reader = query_->GetRegion(&context, Box(60, 60, 60, 0.2));
  v1::GetRegionResponse block;
  ASSERT_TRUE(reader->Read(&block));
  std::thread drain([&] { EXPECT_TRUE(server_->Drain()); });
  while (reader->Read(&block)) {
  }
  EXPECT_NE(reader->Finish().error_code(), Code::OK);
  drain.join();
}

}  // namespace
}  // namespace clearance
