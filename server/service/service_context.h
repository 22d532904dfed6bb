// What all handlers share.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "server/engine/latency.h"
#include "server/engine/map_registry.h"
#include "server/service/access/access.h"
#include "server/service/open_streams.h"
#include "server/service/pins.h"
#include "server/service/worker_pool.h"

namespace clearance {

struct ServiceLimits {
  uint64_t max_message_bytes = 16u << 20;
  uint64_t max_query_points = 100'000;
  uint64_t max_slice_cells = 400'000;
  uint64_t max_region_cells = 64'000'000;
  uint64_t max_trajectories = 10'000;
  uint64_t max_waypoints = 100'000;  // of all trajectories of a call
  uint64_t max_spheres = 1'000;
  uint64_t max_stream_requests = 32;  // of a QueryStream, read and not yet answered
  PinLimits pins;
  uint64_t max_frame_points = 1'100'000;
  uint64_t max_image_pixels = 4'000'000;
  uint64_t max_motions = 4096;
  uint64_t max_maps = 64;
  double max_wait_s = 60.0;
  uint64_t max_streams = 1024;  // open at a time, of all kinds
  uint64_t credits = 8;         // frames in flight, a stream, policy block
  uint64_t live_credits = 256;  // the same, policy drop_oldest_static
  MapConfig map_defaults;
};

// Latencies and outcomes of the RPCs. Thread-safe.
class CallStats {
 public:
  struct Entry {
    std::string method;
    absl::StatusCode code;
    uint64_t count;
  };
  void Record(const char* method, absl::StatusCode code, double ms);
  std::vector<std::pair<std::string, LatencyHistogram>> Latencies() const;
  std::vector<Entry> Counts() const;

 private:
  mutable Mutex mu_;
  std::map<std::string, LatencyHistogram> latencies_ ABSL_GUARDED_BY(mu_);
  std::map<std::pair<std::string, absl::StatusCode>, uint64_t> counts_ ABSL_GUARDED_BY(mu_);
};

struct ServiceContext {
  MapRegistry* registry = nullptr;
  WorkerPool* pool = nullptr;
  const Access* access = nullptr;  // never null while serving
  ServiceLimits limits;
  CallStats calls;
  std::atomic<bool> draining = false;
  // Takes the server out of service: no new frames, what waits settles. False where the time, zero
  // meaning the server's own limit, was not enough. Blocks.
  std::function<bool(std::chrono::milliseconds)> settle;
  std::atomic<int64_t> open_streams = 0;
  OpenStreams streams;             // those that a drain ends
  std::shared_ptr<PinTable> pins;  // never null
  std::chrono::steady_clock::time_point started_at = std::chrono::steady_clock::now();

  double uptime_s() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - started_at).count();
  }
};

// UNAVAILABLE with RetryInfo: what every call answers while the server drains.
absl::Status DrainingError();
// RESOURCE_EXHAUSTED with RetryInfo where max_streams are open. Streams that begin at the same
// moment may exceed it by the number of threads that take them.
absl::Status CheckRoomForStream(const ServiceContext& service);

}  // namespace clearance
