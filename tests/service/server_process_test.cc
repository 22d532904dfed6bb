// The program itself: what it prints, how it stops, which exit codes it has.
#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <optional>

#include "tests/service/service_fixture.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;

// clearance_server with its stdout and stderr in one pipe.
class Process {
 public:
  explicit Process(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), CLEARANCE_SERVER_BINARY);
    int fds[2];
    if (pipe(fds) != 0) abort();
    pid_ = fork();
    if (pid_ == 0) {
      dup2(fds[1], STDOUT_FILENO);
      dup2(fds[1], STDERR_FILENO);
      close(fds[0]);
      close(fds[1]);
      std::vector<char*> argv;
      for (std::string& argument : arguments) argv.push_back(argument.data());
      argv.push_back(nullptr);
      execv(argv[0], argv.data());
      _exit(127);
    }
    close(fds[1]);
    out_ = fdopen(fds[0], "r");
  }
  ~Process() {
    if (!exit_code_) kill(pid_, SIGKILL);
    Wait();
    fclose(out_);
  }

  // Reads up to the line that starts with `start`, or to the end.
  std::string ReadTo(const std::string& start) {
    std::string all;
    char line[4096];
    while (fgets(line, sizeof(line), out_) != nullptr) {
      all += line;
      if (!start.empty() && std::string(line).starts_with(start)) break;
    }
    return all;
  }
  void Terminate() { kill(pid_, SIGTERM); }
  int Wait() {
    if (!exit_code_) {
      int status = 0;
      waitpid(pid_, &status, 0);
      exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    return *exit_code_;
  }

 private:
  pid_t pid_ = -1;
  FILE* out_ = nullptr;
  std::optional<int> exit_code_;
};

std::string TempPath(const char* end) {
  return ::testing::TempDir() + "clearance_process_" + std::to_string(getpid()) + end;
}

std::string AddressIn(const std::string& output) {
  const size_t begin = output.find("gRPC on ") + 8;
  return output.substr(begin, output.find('\n', begin) - begin);
}

TEST(ServerProcess, DrainsOnSigtermAndTellsItsStreamsWhereToResume) {
  const std::string socket = TempPath(".sock");
  Process server({"--listen", "127.0.0.1:0", "--socket", socket, "--http", "127.0.0.1:0"});
  const std::string output = server.ReadTo("ready");
  EXPECT_THAT(output, HasSubstr("gRPC on 127.0.0.1:"));
  EXPECT_THAT(output, HasSubstr("gRPC on unix:" + socket));
  EXPECT_THAT(output, HasSubstr("HTTP on 127.0.0.1:"));
  auto stub = v1::IngestService::NewStub(
      grpc::CreateChannel("unix:" + socket, grpc::InsecureChannelCredentials()));
  IngestClient client(stub.get());
  ASSERT_TRUE(client.Open());
  for (uint64_t id = 1; id <= 3; ++id) ASSERT_TRUE(client.Send(ProtoFrame(id, 100)));
  EXPECT_EQ(client.ReadAck().status(), v1::INGEST_STATUS_INTEGRATED);
  server.Terminate();
  EXPECT_EQ(client.Drain().error_code(), grpc::StatusCode::UNAVAILABLE);
  ASSERT_TRUE(client.closing());
  EXPECT_EQ(client.closing()->last_frame_id(), 1 + client.late_acks().size());
  EXPECT_EQ(server.Wait(), 0);
  EXPECT_NE(access(socket.c_str(), F_OK), 0);
}

TEST(ServerProcess, APortInUseIsExitCodeFiveAndAClearText) {
  Process first({"--listen", "127.0.0.1:0", "--http", "off"});
  const std::string address = AddressIn(first.ReadTo("ready"));
  Process second({"--listen", address, "--http", "off"});
  EXPECT_THAT(second.ReadTo(""), ::testing::AllOf(HasSubstr(address), HasSubstr("in use")));
  EXPECT_EQ(second.Wait(), 5);
  Process third({"--listen", "127.0.0.1:0", "--http", address});
  EXPECT_THAT(third.ReadTo(""), ::testing::AllOf(HasSubstr(address), HasSubstr("--http off")));
  EXPECT_EQ(third.Wait(), 5);
  first.Terminate();
  EXPECT_EQ(first.Wait(), 0);
}

TEST(ServerProcess, AConfigurationThatIsWrongIsExitCodeTwoWithItsLine) {
  const std::string path = TempPath(".yaml");
  std::ofstream(path) << "server:\n  http: off\n  lisen: \"127.0.0.1:0\"\n";
  Process server({"--config", path});
  EXPECT_THAT(server.ReadTo(""), HasSubstr(path + ":3: unknown key 'lisen' in 'server'; did you "
                                                  "mean 'listen'?"));
  EXPECT_EQ(server.Wait(), 2);
  unlink(path.c_str());
  Process exposed({"--listen", "0.0.0.0:0", "--http", "off"});
  EXPECT_THAT(exposed.ReadTo(""), HasSubstr("plain text"));
  EXPECT_EQ(exposed.Wait(), 2);
  Process unknown({"--no-such-flag"});
  unknown.ReadTo("");
  EXPECT_EQ(unknown.Wait(), 2);
}

TEST(ServerProcess, TheShippedConfigurationServes) {
  const std::string socket = TempPath("_default.sock");
  Process server({"--config", "server/config/default.yaml", "--listen", "127.0.0.1:0", "--socket",
                  socket, "--http", "off", "--set", "map.voxel_size_m=0.25"});
  server.ReadTo("ready");
  auto stub = v1::MapService::NewStub(
      grpc::CreateChannel("unix:" + socket, grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  v1::GetMapResponse response;
  ASSERT_TRUE(stub->GetMap(&context, {}, &response).ok());
  EXPECT_EQ(response.info().config().voxel_size_m(), 0.25);
  server.Terminate();
  EXPECT_EQ(server.Wait(), 0);
}

}  // namespace
}  // namespace clearance
