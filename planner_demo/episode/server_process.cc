#include "planner_demo/episode/server_process.h"

#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "absl/strings/str_cat.h"

namespace clearance::demo {
namespace {

constexpr auto kComesUpWithin = std::chrono::seconds(60);

std::string ReadAll(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::Start(const std::string& binary) {
  if (access(binary.c_str(), X_OK) != 0) {
    return absl::NotFoundError(
        absl::StrCat("there is no program ", binary, "; build it or say --server-binary"));
  }
  std::string pattern = (std::filesystem::temp_directory_path() / "clearance-demo-XXXXXX").string();
  if (mkdtemp(pattern.data()) == nullptr) {
    return absl::UnavailableError(absl::StrCat("cannot make a folder like ", pattern));
  }
  const std::string log = pattern + "/log";
  const std::string socket = pattern + "/clearance.sock";
  const pid_t pid = fork();
  if (pid < 0) return absl::UnavailableError("cannot fork");
  if (pid == 0) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);  // it goes when we do, whatever happens to us
    const int fd = open(log.c_str(), O_CREAT | O_WRONLY, 0644);
    dup2(fd, STDOUT_FILENO);
    dup2(fd, STDERR_FILENO);
    execl(binary.c_str(), binary.c_str(), "--listen", "127.0.0.1:0", "--socket", socket.c_str(),
          "--http", "off", static_cast<char*>(nullptr));
    _exit(127);
  }
  std::unique_ptr<ServerProcess> process(new ServerProcess(pattern, pid));
  const auto deadline = std::chrono::steady_clock::now() + kComesUpWithin;
  while (std::chrono::steady_clock::now() < deadline) {
    const std::string text = ReadAll(log);
    if (text.rfind("ready", 0) == 0 || text.find("\nready") != std::string::npos) return process;
    int status = 0;
    if (waitpid(pid, &status, WNOHANG) == pid) {
      process->pid_ = -1;
      return absl::UnavailableError(absl::StrCat(binary, " ended at once: ", text));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return absl::UnavailableError(absl::StrCat(binary, " does not say ready: ", ReadAll(log)));
}

ServerProcess::~ServerProcess() {
  Stop();
  std::error_code ignored;
  std::filesystem::remove_all(folder_, ignored);
}

void ServerProcess::Stop() {
  if (pid_ < 0) return;
  kill(pid_, SIGCONT);
  kill(pid_, SIGTERM);
  waitpid(pid_, nullptr, 0);
  pid_ = -1;
}

void ServerProcess::Suspend() {
  if (pid_ > 0) kill(pid_, SIGSTOP);
}

void ServerProcess::Resume() {
  if (pid_ > 0) kill(pid_, SIGCONT);
}

}  // namespace clearance::demo
