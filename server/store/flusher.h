// Syncs logs now and then, on one thread for all of them.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

namespace clearance {

// Thread-safe.
class Flusher {
 public:
  explicit Flusher(std::chrono::milliseconds period);
  ~Flusher();

  // Calls `flush` once every period until Remove, which waits for a call that runs.
  uint64_t Add(std::function<void()> flush);
  void Remove(uint64_t id);

 private:
  void Run();

  const std::chrono::milliseconds period_;
  std::mutex mu_;
  std::condition_variable changed_;
  bool stopping_ = false;  // guarded by mu_
  uint64_t next_id_ = 1;   // guarded by mu_
  uint64_t running_ = 0;   // guarded by mu_: the entry that is being called
  std::map<uint64_t, std::function<void()>> entries_;  // guarded by mu_
  std::thread thread_;
};

}  // namespace clearance
