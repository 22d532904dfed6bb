// clearance_server as a child that can be killed and started again on the same folder.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <string>
#include <vector>

namespace clearance {

class ServerProcess {
 public:
  ServerProcess(std::string binary, std::vector<std::string> arguments, std::string log)
      : binary_(std::move(binary)), arguments_(std::move(arguments)), log_(std::move(log)) {}
  ~ServerProcess() { Kill(); }

  pid_t Start() {
    pid_ = fork();
    if (pid_ != 0) return pid_;
    const int fd = open(log_.c_str(), O_CREAT | O_WRONLY | O_APPEND, 0644);
    dup2(fd, STDOUT_FILENO);
    dup2(fd, STDERR_FILENO);
    std::vector<char*> argv = {binary_.data()};
    for (std::string& argument : arguments_) argv.push_back(argument.data());
    argv.push_back(nullptr);
    execv(argv[0], argv.data());
    _exit(127);
  }
  void Kill() { End(SIGKILL); }
  // The exit code.
  int Terminate() { return End(SIGTERM); }
  // The exit code of a server that ends by itself.
  int Wait() { return End(0); }
  pid_t pid() const { return pid_; }

 private:
  int End(int signal) {
    if (pid_ <= 0) return -1;
    if (signal != 0) kill(pid_, signal);
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

  std::string binary_;
  std::vector<std::string> arguments_;
  std::string log_;
  pid_t pid_ = -1;
};

}  // namespace clearance
