#include "server/config/server_config.h"

#include <arpa/inet.h>

#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

namespace clearance {
namespace {

constexpr size_t kMaxSocketPath = 107;  // sun_path holds 108 bytes with its end

absl::Status InRange(const char* key, double got, double low, double high) {
  if (got >= low && got <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: got %g, expected %g to %g", key, got, low, high));
}

absl::Status CheckAddress(std::string_view address, std::string_view key, bool allow_remote) {
  const absl::StatusOr<HostPort> parsed = ParseHostPort(address, key);
  if (!parsed.ok()) return parsed.status();
  if (!allow_remote && !IsLoopback(parsed->host)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: got '%s', which others can reach in plain text; expected a loopback address, "
        "or security.certificate and security.key for TLS. Set server.allow_remote_plaintext "
        "(--allow-remote-plaintext) to serve it all the same",
        key, address));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ServerConfig::Validate() const {
  const bool tls = !tls_certificate.empty();
  if (tls == tls_key.empty()) {
    return absl::InvalidArgumentError(
        "security.certificate and security.key: got one of them, expected both or none");
  }
  if (!tls && !tls_client_ca.empty()) {
    return absl::InvalidArgumentError("security.client_ca: needs security.certificate and key");
  }
  for (const std::string& address : listen) {
    if (auto s = CheckAddress(address, "server.listen", tls || allow_remote_plaintext); !s.ok()) {
      return s;
    }
  }
  if (listen.empty() && socket.empty()) {
    return absl::InvalidArgumentError("server.listen and server.socket: got neither, expected one");
  }
  if (socket.size() > kMaxSocketPath) {
    return absl::InvalidArgumentError(
        absl::StrFormat("server.socket: got %d bytes, limit %d", socket.size(), kMaxSocketPath));
  }
  if (http != "off" && !http.empty()) {
    if (auto s = CheckAddress(http, "server.http", allow_remote_plaintext); !s.ok()) return s;
  }
  const struct {
    const char* key;
    double got, low, high;
  } ranges[] = {
      {"server.worker_threads", static_cast<double>(worker_threads), 1, 256},
      {"server.worker_queue", static_cast<double>(worker_queue), 1, 1e6},
      {"server.drain_timeout_s", drain_timeout_s, 0, 600},
      {"limits.max_message_bytes", static_cast<double>(max_message_bytes), 65536, 1u << 30},
      {"limits.max_maps", static_cast<double>(max_maps), 1, 1e6},
      // Replies stay below the 4 MiB that every gRPC client takes by default.
      {"limits.max_query_points", static_cast<double>(max_query_points), 1, 100'000},
      {"limits.max_slice_cells", static_cast<double>(max_slice_cells), 1, 400'000},
      {"limits.max_frame_points", static_cast<double>(max_frame_points), 1, 1e8},
      {"limits.max_image_pixels", static_cast<double>(max_image_pixels), 1, 1e8},
      {"limits.max_motions", static_cast<double>(max_motions), 0, 65535},
      {"limits.max_wait_s", max_wait_s, 0, 3600},
      {"limits.max_region_cells", static_cast<double>(max_region_cells), 1, 1e9},
      {"limits.max_trajectories", static_cast<double>(max_trajectories), 1, 10'000},
      {"limits.max_waypoints", static_cast<double>(max_waypoints), 1, 100'000},
      {"limits.max_spheres", static_cast<double>(max_spheres), 1, 1'000},
      {"limits.max_stream_requests", static_cast<double>(max_stream_requests), 1, 4096},
      {"limits.max_pins", static_cast<double>(max_pins), 0, 1e5},
      {"limits.pin_ttl_s", pin_ttl_s, 0.001, max_pin_ttl_s},
      {"limits.max_pin_ttl_s", max_pin_ttl_s, 0.001, 86'400},
      {"limits.max_streams", static_cast<double>(max_streams), 1, 1e6},
      {"store.fsync_interval_s", store.fsync_interval_s, 0.001, 60},
      {"store.segment_bytes", static_cast<double>(store.segment_bytes), 4096, 1u << 30},
      {"store.snapshot_period_s", store.snapshot_period_s, 0, 1e7},
      {"store.keep_snapshots", static_cast<double>(store.keep_snapshots), 0, 1e6},
      {"ingest.queue_frames", static_cast<double>(queue_frames), 1, 4096},
      {"ingest.credits", static_cast<double>(credits), 1, 4096},
      {"ingest.live_credits", static_cast<double>(live_credits), 1, 65536},
  };
  for (const auto& range : ranges) {
    if (auto s = InRange(range.key, range.got, range.low, range.high); !s.ok()) return s;
  }
  if (absl::Status s = map.Validate(); !s.ok()) {
    return absl::InvalidArgumentError(absl::StrFormat("map.%s", s.message()));
  }
  return absl::OkStatus();
}

absl::StatusOr<HostPort> ParseHostPort(std::string_view address, std::string_view field) {
  HostPort result;
  const size_t colon = address.rfind(':');
  const auto bad = [&] {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: got '%s', expected HOST:PORT with a port of 0 to 65535", field, address));
  };
  if (colon == std::string_view::npos || colon == 0) return bad();
  result.host = std::string(address.substr(0, colon));
  const std::string port(address.substr(colon + 1));
  if (!absl::SimpleAtoi(port, &result.port) || result.port < 0 || result.port > 65535) return bad();
  if (result.host.front() == '[') {
    if (result.host.size() < 3 || result.host.back() != ']') return bad();
    result.host = result.host.substr(1, result.host.size() - 2);
  } else if (result.host.find(':') != std::string::npos) {
    return bad();
  }
  return result;
}

bool IsLoopback(std::string_view host) {
  const std::string name(host);
  in_addr v4;
  if (inet_pton(AF_INET, name.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  in6_addr v6;
  if (inet_pton(AF_INET6, name.c_str(), &v6) == 1) return IN6_IS_ADDR_LOOPBACK(&v6);
  return name == "localhost";
}

}  // namespace clearance
