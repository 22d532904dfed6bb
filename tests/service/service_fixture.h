// A whole server in the test's process: no port, no network, fake or real maps.
#pragma once

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "clearance/v1/admin.grpc.pb.h"
#include "clearance/v1/export.grpc.pb.h"
#include "clearance/v1/ingest.grpc.pb.h"
#include "clearance/v1/map.grpc.pb.h"
#include "clearance/v1/query.grpc.pb.h"
#include "clearance/v1/snapshot.grpc.pb.h"
#include "clearance/v1/watch.grpc.pb.h"
#include "grpc/health/v1/health.grpc.pb.h"
#include "server/service/server.h"
#include "tests/engine/fake_model.h"
#include "tests/engine/gate.h"

namespace clearance {

// Little-endian array bytes.
template <typename T>
std::string Bytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}
template <typename T>
std::vector<T> Values(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

inline v1::Frame ProtoFrame(uint64_t id, int points = 1) {
  v1::Frame frame;
  frame.set_frame_id(id);
  frame.set_stamp_ns(static_cast<int64_t>(id) * 100'000'000);
  frame.mutable_world_from_sensor()->set_qw(1);
  if (points > 0) {
    frame.mutable_cloud()->set_points_f32(Bytes(std::vector<float>(3 * points, 1.5f)));
  }
  return frame;
}

class ServiceFixture : public ::testing::Test {
 protected:
  // `default` exists.
  void StartServer(RegistryOptions registry, ServerOptions options = {}) {
    if (!registry.model) registry.model = FakeModelFactory(log_);
    registry_ = std::make_unique<MapRegistry>(std::move(registry));
    ASSERT_TRUE(registry_->Create("default", options.limits.map_defaults).ok());
    auto server = ClearanceServer::Start(registry_.get(), options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
    // A call made in process after the server has stopped crashes inside gRPC 1.51; over a socket
    // it fails as it should.
    channel_ = options.socket.empty() ? server_->InProcessChannel()
                                      : grpc::CreateChannel("unix:" + options.socket,
                                                            grpc::InsecureChannelCredentials());
    ingest_ = v1::IngestService::NewStub(channel_);
    query_ = v1::QueryService::NewStub(channel_);
    map_ = v1::MapService::NewStub(channel_);
    exports_ = v1::ExportService::NewStub(channel_);
    admin_ = v1::AdminService::NewStub(channel_);
    health_ = grpc::health::v1::Health::NewStub(channel_);
  }
  void StartServer() { StartServer(RegistryOptions{}); }
  RegistryOptions Held(Gate* gate) {
    RegistryOptions options;
    options.engine.before_integrate = [gate](const Frame&) { gate->Pass(); };
    return options;
  }

  v1::FrameAck Ingest(const v1::Frame& frame, const std::string& map = "",
                      const std::string& source = "") {
    grpc::ClientContext context;
    v1::IngestFrameRequest request;
    request.set_map(map);
    request.set_source_id(source);
    *request.mutable_frame() = frame;
    v1::IngestFrameResponse response;
    const grpc::Status status = ingest_->IngestFrame(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.ack();
  }

  grpc::Status Query(const v1::QueryPointsRequest& request, v1::QueryPointsResponse* response) {
    grpc::ClientContext context;
    return query_->QueryPoints(&context, request, response);
  }
  static v1::QueryPointsRequest OnePoint(float x = 0, float y = 0, float z = 0) {
    v1::QueryPointsRequest request;
    request.set_positions_f32(Bytes(std::vector<float>{x, y, z}));
    return request;
  }
  static std::string SocketPath() {
    return ::testing::TempDir() + "clearance_test_" + std::to_string(getpid()) + ".sock";
  }
  uint64_t Revision(const std::string& map = "") {
    v1::QueryPointsRequest request = OnePoint();
    request.set_map(map);
    v1::QueryPointsResponse response;
    EXPECT_TRUE(Query(request, &response).ok());
    return response.stamp().revision();
  }

  std::shared_ptr<FakeLog> log_ = std::make_shared<FakeLog>();
  std::unique_ptr<MapRegistry> registry_;
  std::unique_ptr<ClearanceServer> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::IngestService::Stub> ingest_;
  std::unique_ptr<v1::QueryService::Stub> query_;
  std::unique_ptr<v1::MapService::Stub> map_;
  std::unique_ptr<v1::ExportService::Stub> exports_;
  std::unique_ptr<v1::AdminService::Stub> admin_;
  std::unique_ptr<grpc::health::v1::Health::Stub> health_;
};

// One ingest stream, driven from the test's thread.
class IngestClient {
 public:
  explicit IngestClient(v1::IngestService::Stub* stub) : stream_(stub->IngestFrames(&context_)) {}

  bool Open(const std::string& map = "", const std::string& source = "") {
    v1::IngestFramesRequest request;
    request.mutable_open()->set_map(map);
    request.mutable_open()->set_source_id(source);
    if (!stream_->Write(request)) return false;
    v1::IngestFramesResponse response;
    if (!stream_->Read(&response) || !response.has_opened()) return false;
    opened_ = response.opened();
    return true;
  }
  bool Send(const v1::Frame& frame) {
    v1::IngestFramesRequest request;
    *request.mutable_frame() = frame;
    return stream_->Write(request);
  }
  bool Write(const v1::IngestFramesRequest& request) { return stream_->Write(request); }
  // The next ack, counting credits on the way; an empty one at the end or at closing.
  v1::FrameAck ReadAck() {
    v1::IngestFramesResponse response;
    while (stream_->Read(&response)) {
      if (response.has_ack()) return response.ack();
      if (response.has_credit()) credits_ += response.credit().frames();
      if (response.has_closing()) {
        closing_ = response.closing();
        break;
      }
    }
    return {};
  }
  // Half-closes, reads to the end.
  grpc::Status Finish() {
    stream_->WritesDone();
    return Drain();
  }
  grpc::Status Drain() {
    v1::IngestFramesResponse response;
    while (stream_->Read(&response)) {
      if (response.has_ack()) late_acks_.push_back(response.ack());
      if (response.has_closing()) closing_ = response.closing();
    }
    return stream_->Finish();
  }
  void Cancel() { context_.TryCancel(); }

  const v1::IngestOpened& opened() const { return opened_; }
  const std::optional<v1::IngestClosing>& closing() const { return closing_; }
  const std::vector<v1::FrameAck>& late_acks() const { return late_acks_; }
  uint64_t credits() const { return credits_; }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::IngestFramesRequest, v1::IngestFramesResponse>>
      stream_;
  v1::IngestOpened opened_;
  std::optional<v1::IngestClosing> closing_;
  std::vector<v1::FrameAck> late_acks_;
  uint64_t credits_ = 0;
};

}  // namespace clearance
