#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "server/service/http/http_server.h"
#include "tests/service/service_fixture.h"

// Last: it brings <resolv.h>, whose macro _res is a name inside Eigen.
#include <httplib.h>

namespace clearance {
namespace {

using ::testing::HasSubstr;

class ListenTest : public ServiceFixture {
 protected:
  void SetUp() override {
    registry_ = std::make_unique<MapRegistry>(FakeRegistry(log_, 4));
    ASSERT_TRUE(registry_->Create("default", {}).ok());
    path_ = SocketPath();
  }
  void TearDown() override { unlink(path_.c_str()); }

  static bool Healthy(const std::string& address) {
    auto stub = grpc::health::v1::Health::NewStub(
        grpc::CreateChannel(address, grpc::InsecureChannelCredentials()));
    grpc::ClientContext context;
    context.set_wait_for_ready(true);
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(30));
    grpc::health::v1::HealthCheckResponse response;
    return stub->Check(&context, {}, &response).ok();
  }

  std::string path_;
};

TEST_F(ListenTest, ServesTcpAndAUnixSocketSideBySide) {
  ServerOptions options;
  options.listen = {"127.0.0.1:0", "localhost:0"};
  options.socket = path_;
  auto server = ClearanceServer::Start(registry_.get(), options);
  ASSERT_TRUE(server.ok()) << server.status();
  ASSERT_EQ((*server)->addresses().size(), 3u);
  for (const std::string& address : (*server)->addresses())
    EXPECT_TRUE(Healthy(address)) << address;
  EXPECT_TRUE((*server)->Drain());
  EXPECT_NE(access(path_.c_str(), F_OK), 0) << "the socket is gone";
}

TEST_F(ListenTest, APortInUseIsAClearError) {
  ServerOptions options;
  options.listen = {"127.0.0.1:0"};
  auto first = ClearanceServer::Start(registry_.get(), options);
  ASSERT_TRUE(first.ok());
  options.listen = (*first)->addresses();
  const auto second = ClearanceServer::Start(registry_.get(), options);
  EXPECT_TRUE(absl::IsUnavailable(second.status()));
  EXPECT_THAT(std::string(second.status().message()), HasSubstr(options.listen[0]));
  EXPECT_THAT(std::string(second.status().message()), HasSubstr("in use"));
  const auto http = HttpServer::Start(options.listen[0], &(*first)->context());
  EXPECT_TRUE(absl::IsUnavailable(http.status()));
  EXPECT_THAT(std::string(http.status().message()), HasSubstr("in use"));
}

TEST_F(ListenTest, ASocketThatAnswersIsNotStolenAndAStaleOneIsReplaced) {
  ServerOptions options;
  options.socket = path_;
  {
    auto first = ClearanceServer::Start(registry_.get(), options);
    ASSERT_TRUE(first.ok());
    EXPECT_THAT(std::string(ClearanceServer::Start(registry_.get(), options).status().message()),
                HasSubstr("another server"));
    EXPECT_TRUE(Healthy("unix:" + path_));
  }
  const int fd = socket(AF_UNIX, SOCK_STREAM, 0);
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  std::snprintf(address.sun_path, sizeof(address.sun_path), "%s", path_.c_str());
  ASSERT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  close(fd);  // a socket file without a server, as a crash leaves it
  MapRegistry registry(FakeRegistry(log_, 4));
  auto next = ClearanceServer::Start(&registry, options);
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_TRUE(Healthy("unix:" + path_));
}

TEST_F(ListenTest, AFileThatIsNoSocketIsLeftAlone) {
  std::ofstream(path_) << "precious";
  ServerOptions options;
  options.socket = path_;
  EXPECT_THAT(std::string(ClearanceServer::Start(registry_.get(), options).status().message()),
              HasSubstr("not a socket"));
  EXPECT_EQ(access(path_.c_str(), F_OK), 0);
}

TEST_F(ListenTest, HttpTellsHealthReadinessAndMetrics) {
  auto server = ClearanceServer::Start(registry_.get(), {});
  ASSERT_TRUE(server.ok());
  auto http = HttpServer::Start("127.0.0.1:0", &(*server)->context());
  ASSERT_TRUE(http.ok()) << http.status();
  const std::string address = (*http)->address();
  httplib::Client client("127.0.0.1", std::stoi(address.substr(address.rfind(':') + 1)));
  EXPECT_EQ(client.Get("/healthz")->status, 200);
  EXPECT_EQ(client.Get("/readyz")->status, 200);
  EXPECT_EQ(client.Get("/nothing")->status, 404);
  const auto metrics = client.Get("/metrics");
  ASSERT_EQ(metrics->status, 200);
  EXPECT_THAT(metrics->body, HasSubstr("clearance_map_revision{map=\"default\"} 0"));
  EXPECT_THAT(metrics->body, HasSubstr("# TYPE clearance_frames_total counter"));
  (*server)->Drain();
  EXPECT_EQ(client.Get("/healthz")->status, 200);
  EXPECT_EQ(client.Get("/readyz")->status, 503);
}

}  // namespace
}  // namespace clearance
