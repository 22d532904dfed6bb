// A clearance_server process of a test's own, on a unix socket in a folder of its own.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "client/esdf_client.h"
#include "tests/client/test_files.h"

namespace clearance::client {

class LiveServer {
 public:
  LiveServer();
  ~LiveServer();  // stops it and waits
  std::string address() const { return (folder_.path() / "clearance.sock").string(); }
  const TestFolder& folder() const { return folder_; }
  // Sends the signal; with SIGTERM, waits for the exit and returns its code.
  int Terminate();
  std::unique_ptr<EsdfClient> Connect(const std::string& map = "") const;

 private:
  TestFolder folder_;
  pid_t pid_ = -1;
};

// Forwards bytes between its own socket and another, until it is told to cut.
class CuttingProxy {
 public:
  explicit CuttingProxy(const std::string& target);
  ~CuttingProxy();
  std::string address() const { return (folder_.path() / "proxy.sock").string(); }
  // Breaks every connection; new ones are accepted. Returns how many there were.
  int Cut();

 private:
  struct Pair;
  void Accept();

  TestFolder folder_;
  const std::string target_;
  int listener_ = -1;
  std::atomic<bool> stop_ = false;
  absl::Mutex mutex_;
  std::vector<std::unique_ptr<Pair>> pairs_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

// A room of 6 x 6 x 3 m seen from its middle, noise-free; optionally a box-shaped object 7 at
// (1.5 + 0.1 * index, 0, 0), 0.6 m a side, labelled, with its motion.
Frame RoomFrame(uint64_t index, bool with_object = false);

}  // namespace clearance::client
