// A clearance_server of one's own.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace clearance::demo {

// Runs on a unix socket in a temporary folder, which goes with it. Start it before any connection
// is opened: it forks.
class ServerProcess {
 public:
  // `binary` with the defaults of its kind. NOT_FOUND where it is not there, UNAVAILABLE where it
  // does not come up (with the end of its log).
  static absl::StatusOr<std::unique_ptr<ServerProcess>> Start(const std::string& binary);
  ~ServerProcess();  // Stop()

  std::string address() const { return folder_ + "/clearance.sock"; }
  // SIGTERM, and waits.
  void Stop();
  // Suspends and resumes the process: a server that does not answer.
  void Suspend();
  void Resume();

 private:
  ServerProcess(std::string folder, pid_t pid) : folder_(std::move(folder)), pid_(pid) {}

  std::string folder_;
  pid_t pid_;
};

}  // namespace clearance::demo
