// What a server is started with: a strict YAML file, then environment, then flags.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "server/map/map_config.h"
#include "server/store/segment_log.h"

namespace clearance {

struct ServerConfig {
  // server
  std::vector<std::string> listen = {"127.0.0.1:50051"};  // HOST:PORT, gRPC
  std::string socket;                                     // path of a unix socket; empty = none
  std::string http = "127.0.0.1:8080";                    // metrics and health; "off"
  bool allow_remote_plaintext = false;                    // serve beyond loopback without TLS
  int worker_threads = 2;                                 // for large queries and exports
  int worker_queue = 256;                                 // calls that may wait for them
  double drain_timeout_s = 8.0;

  // log, on stderr
  enum class LogFormat { kText, kJson };
  enum class LogCalls { kNone, kFailed, kAll };
  LogFormat log_format = LogFormat::kText;
  LogCalls log_calls = LogCalls::kFailed;

  // security: paths of PEM files for TLS on the TCP addresses, and who may do what
  std::string tls_certificate, tls_key;
  std::string tls_client_ca;  // set: clients must show a certificate
  std::string access_file;    // tokens and certificate names with their rights; empty = no check

  // limits
  uint64_t max_message_bytes = 16u << 20;
  uint64_t max_maps = 64;
  uint64_t max_query_points = 100'000;
  uint64_t max_slice_cells = 400'000;
  uint64_t max_frame_points = 1'100'000;  // of a cloud: fits a message, labels included
  uint64_t max_image_pixels = 4'000'000;
  uint64_t max_motions = 4096;
  double max_wait_s = 60.0;
  uint64_t max_region_cells = 64'000'000;
  uint64_t max_trajectories = 10'000;
  uint64_t max_waypoints = 100'000;  // of all trajectories of a call
  uint64_t max_spheres = 1'000;
  uint64_t max_stream_requests = 32;  // of a QueryStream, read and not yet answered
  uint64_t max_pins = 64;             // of one map
  double pin_ttl_s = 10;              // where the request leaves it open
  double max_pin_ttl_s = 120;

  // ingest
  uint64_t queue_frames = 8;    // frames with points that wait, a map
  uint64_t credits = 8;         // frames in flight, a stream, policy block
  uint64_t live_credits = 256;  // the same, policy drop_oldest_static

  // limits, of memory and streams
  uint64_t memory_limit_bytes = 0;  // resident, of the process; 0 = none
  bool evict_over_memory = false;   // maps then forget what is far instead of refusing frames
  uint64_t max_streams = 1024;      // open at a time

  // store
  struct Store {
    std::string dir;  // empty: nothing is kept on disk
    SyncPolicy fsync = SyncPolicy::kInterval;
    double fsync_interval_s = 0.2;
    uint64_t segment_bytes = 64u << 20;
    double snapshot_period_s = 0;  // 0 = only when asked
    uint64_t keep_snapshots = 3;   // newest automatic ones; 0 = all
    bool recover_damaged = false;
  } store;

  // map: of `default`, and what CreateMap leaves open
  bool create_default_map = true;
  MapConfig map;

  // INVALID_ARGUMENT naming the key, what it is and what it may be.
  absl::Status Validate() const;
};

// Reads `text` over `config`. INVALID_ARGUMENT "<name>:<line>: ..." for a syntax error, an unknown
// or repeated key (with the nearest known one), a value of another type. Not validated yet.
absl::Status ApplyYaml(std::string_view text, std::string_view name, ServerConfig* config);
// NOT_FOUND or INVALID_ARGUMENT.
absl::Status ApplyFile(const std::string& path, ServerConfig* config);

// Sets one key, for example "map.voxel_size_m", to a YAML value.
absl::Status ApplySetting(std::string_view key, const std::string& value, std::string_view origin,
                          ServerConfig* config);
// Environment: CLEARANCE_<SECTION>_<KEY> for every key, for example CLEARANCE_MAP_VOXEL_SIZE_M;
// CLEARANCE_LISTEN, CLEARANCE_SOCKET and CLEARANCE_HTTP for short.
absl::Status ApplyEnvironment(ServerConfig* config);

// All keys, in the order of the documentation.
std::vector<std::string> ConfigKeys();

// Host and port of "HOST:PORT" or "[V6]:PORT". INVALID_ARGUMENT naming `field`.
struct HostPort {
  std::string host;
  int port = 0;
};
absl::StatusOr<HostPort> ParseHostPort(std::string_view address, std::string_view field);
bool IsLoopback(std::string_view host);

}  // namespace clearance
