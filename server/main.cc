// clearance_server: wiring only.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "server/config/server_config.h"
#include "server/engine/live_map.h"
#include "server/engine/map_registry.h"
#include "server/service/frame_codec.h"
#include "server/service/http/http_server.h"
#include "server/service/log.h"
#include "server/service/server.h"

namespace {

// As the `clearance` command's: 2 usage, 4 bad data, 5 unavailable.
enum ExitCode { kOk = 0, kFailed = 1, kUsage = 2, kBadData = 4, kUnavailable = 5 };

struct Flags {
  std::string config;
  std::vector<std::string> listen;
  std::string socket, http, store;
  std::vector<std::string> settings;
  bool allow_remote_plaintext = false;
};

absl::Status Configure(const Flags& flags, clearance::ServerConfig* config) {
  if (!flags.config.empty()) {
    if (absl::Status s = clearance::ApplyFile(flags.config, config); !s.ok()) return s;
  }
  if (absl::Status s = clearance::ApplyEnvironment(config); !s.ok()) return s;
  for (const std::string& setting : flags.settings) {
    const size_t equals = setting.find('=');
    if (equals == std::string::npos) {
      return absl::InvalidArgumentError("--set: got '" + setting + "', expected KEY=VALUE");
    }
    if (absl::Status s = clearance::ApplySetting(setting.substr(0, equals),
                                                 setting.substr(equals + 1), "--set", config);
        !s.ok()) {
      return s;
    }
  }
  if (!flags.listen.empty()) config->listen = flags.listen;
  if (!flags.socket.empty()) config->socket = flags.socket == "none" ? "" : flags.socket;
  if (!flags.http.empty()) config->http = flags.http;
  if (!flags.store.empty()) config->store.dir = flags.store == "none" ? "" : flags.store;
  if (flags.allow_remote_plaintext) config->allow_remote_plaintext = true;
  return config->Validate();
}

std::chrono::milliseconds Milliseconds(double seconds) {
  return std::chrono::milliseconds(static_cast<int64_t>(seconds * 1e3));
}

clearance::RegistryOptions RegistryOptionsOf(const clearance::ServerConfig& config) {
  clearance::RegistryOptions options;
  options.model = clearance::LiveMapFactory();
  options.max_maps = config.max_maps;
  options.engine.queue_frames = config.queue_frames;
  options.engine.kept_revisions = 3;  // each holds the blocks that the next ones replaced
  options.engine.codec = clearance::WireFrameCodec();
  options.engine.process_memory_cap_bytes = config.memory_limit_bytes;
  options.engine.evict_over_cap = config.evict_over_memory;
  options.load = clearance::LiveMapLoader();
  options.snapshots.period = Milliseconds(config.store.snapshot_period_s);
  options.snapshots.keep = config.store.keep_snapshots;
  return options;
}

clearance::StoreOptions StoreOptionsOf(const clearance::ServerConfig::Store& config) {
  clearance::StoreOptions options;
  options.path = config.dir;
  options.sync = config.fsync;
  options.sync_interval = Milliseconds(config.fsync_interval_s);
  options.segment_bytes = config.segment_bytes;
  options.recover_damaged = config.recover_damaged;
  return options;
}

clearance::ServerOptions ServerOptionsOf(const clearance::ServerConfig& config) {
  clearance::ServerOptions options;
  options.listen = config.listen;
  options.socket = config.socket;
  options.tls = {config.tls_certificate, config.tls_key, config.tls_client_ca};
  options.access_file = config.access_file;
  options.limits.max_message_bytes = config.max_message_bytes;
  options.limits.max_query_points = config.max_query_points;
  options.limits.max_slice_cells = config.max_slice_cells;
  options.limits.max_frame_points = config.max_frame_points;
  options.limits.max_image_pixels = config.max_image_pixels;
  options.limits.max_motions = config.max_motions;
  options.limits.max_maps = config.max_maps;
  options.limits.max_wait_s = config.max_wait_s;
  options.limits.credits = config.credits;
  options.limits.live_credits = config.live_credits;
  options.limits.map_defaults = config.map;
  options.worker_threads = config.worker_threads;
  options.worker_queue = config.worker_queue;
  options.limits.max_streams = config.max_streams;
  options.limits.max_region_cells = config.max_region_cells;
  options.limits.max_trajectories = config.max_trajectories;
  options.limits.max_waypoints = config.max_waypoints;
  options.limits.max_spheres = config.max_spheres;
  options.limits.max_stream_requests = config.max_stream_requests;
  options.limits.pins = {config.max_pins, config.pin_ttl_s, config.max_pin_ttl_s};
  switch (config.log_calls) {
    case clearance::ServerConfig::LogCalls::kNone:
      options.log_calls = clearance::CallLogging::kNone;
      break;
    case clearance::ServerConfig::LogCalls::kFailed:
      options.log_calls = clearance::CallLogging::kFailed;
      break;
    case clearance::ServerConfig::LogCalls::kAll:
      options.log_calls = clearance::CallLogging::kAll;
      break;
  }
  options.drain_timeout = Milliseconds(config.drain_timeout_s);
  return options;
}

// How far the server has come: lines on stdout for whoever started it, or events of the JSON log.
class Progress {
 public:
  explicit Progress(const clearance::ServerConfig& config)
      : json_(config.log_format == clearance::ServerConfig::LogFormat::kJson) {
    clearance::SetUpLog(json_ ? clearance::LogFormat::kJson : clearance::LogFormat::kText);
  }
  void Say(const std::string& what) const {
    if (json_) {
      clearance::Log(spdlog::level::info, what, nlohmann::ordered_json::object());
    } else {
      std::cout << what << std::endl;
    }
  }
  void Warn(const std::string& what) const {
    if (json_) {
      clearance::Log(spdlog::level::warn, what, nlohmann::ordered_json::object());
    } else {
      std::cerr << "clearance_server: " << what << std::endl;
    }
  }

 private:
  const bool json_;
};

int Fail(const absl::Status& status, int code) {
  std::cerr << "clearance_server: " << status.message() << std::endl;
  return code;
}

int Serve(const clearance::ServerConfig& config, const sigset_t& stop_signals) {
  const Progress progress(config);
  std::unique_ptr<clearance::DataDirectory> storage;
  if (!config.store.dir.empty()) {
    auto opened = clearance::DataDirectory::Open(StoreOptionsOf(config.store));
    if (!opened.ok()) {
      return Fail(opened.status(),
                  absl::IsFailedPrecondition(opened.status()) ? kUnavailable : kFailed);
    }
    storage = *std::move(opened);
  }
  clearance::RegistryOptions options = RegistryOptionsOf(config);
  options.storage = storage.get();
  clearance::MapRegistry registry(std::move(options));
  const auto server = clearance::ClearanceServer::Start(&registry, ServerOptionsOf(config));
  if (!server.ok()) return Fail(server.status(), kUnavailable);
  std::unique_ptr<clearance::HttpServer> http;
  if (config.http != "off" && !config.http.empty()) {
    auto started = clearance::HttpServer::Start(config.http, &(*server)->context());
    if (!started.ok()) {
      return Fail(absl::Status(started.status().code(),
                               std::string(started.status().message()) + " (--http off for none)"),
                  kUnavailable);
    }
    http = *std::move(started);
  }
  for (const std::string& address : (*server)->addresses()) progress.Say("gRPC on " + address);
  if (http) progress.Say("HTTP on " + http->address());
  const absl::Status recovered = registry.Recover(
      [&progress](const std::string& note) { progress.Warn("recovery: " + note); });
  if (!recovered.ok()) {
    return Fail(recovered, absl::IsDataLoss(recovered) ? kBadData : kFailed);
  }
  if (config.create_default_map && !registry.Get(clearance::kDefaultMapId).ok()) {
    const auto map = registry.Create(clearance::kDefaultMapId, config.map);
    if (!map.ok()) return Fail(map.status(), kFailed);
  }
  (*server)->Loaded();
  if (config.allow_remote_plaintext && config.tls_certificate.empty()) {
    progress.Warn(
        "warning: serving in plain text; whoever reaches an address above can read every call and "
        "every token");
  }
  progress.Say("ready");

  int signal = 0;
  sigwait(&stop_signals, &signal);
  progress.Say("draining");
  const bool settled = (*server)->Drain();
  progress.Say(settled ? "stopped" : "stopped; some frames were left unsettled");
  return kOk;
}

}  // namespace

int main(int argc, char** argv) {
  // Blocked before any thread starts, so that only sigwait sees them.
  sigset_t stop_signals;
  sigemptyset(&stop_signals);
  sigaddset(&stop_signals, SIGTERM);
  sigaddset(&stop_signals, SIGINT);
  // A file size limit is an error of the write, not the end.
  signal(SIGXFSZ, SIG_IGN);
  pthread_sigmask(SIG_BLOCK, &stop_signals, nullptr);

  CLI::App app("Clearance: a map server that answers how far the nearest surface is.");
  Flags flags;
  app.add_option("--config", flags.config, "YAML file; see server/config/default.yaml");
  app.add_option("--listen", flags.listen,
                 "HOST:PORT for gRPC; repeatable; replaces server.listen");
  app.add_option("--socket", flags.socket, "path of a unix socket for gRPC, or none");
  app.add_option("--http", flags.http, "HOST:PORT for metrics and health, or off");
  app.add_option("--store", flags.store,
                 "folder for the frame log and snapshots, or none; as store.dir");
  app.add_option("--set", flags.settings,
                 "KEY=VALUE, for example map.voxel_size_m=0.2; repeatable");
  app.add_flag("--allow-remote-plaintext", flags.allow_remote_plaintext,
               "serve plain text beyond loopback");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    const int code = app.exit(error);
    return code == 0 ? kOk : kUsage;
  }
  clearance::ServerConfig config;
  if (const absl::Status s = Configure(flags, &config); !s.ok()) return Fail(s, kUsage);
  return Serve(config, stop_signals);
}
