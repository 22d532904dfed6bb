// Kills a server with SIGKILL at random moments, again and again, while a client streams frames
// into it and edits and snapshots its map: no acknowledged frame is lost, none is applied twice,
// and in the end the map equals, byte for byte, that of a run which nothing disturbed.
//
//   kill_program SERVER_BINARY [--rounds 50] [--seed 1] [--sync each|interval|off]
#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <map>
#include <mutex>
#include <random>
#include <set>
#include <thread>

#include "absl/time/clock.h"
#include "clearance/v1/map.grpc.pb.h"
#include "client/channel.h"
#include "client/esdf_client.h"
#include "proto/wire/frame.h"
#include "server/engine/live_map.h"
#include "server/store/file.h"
#include "server/store/manifest.h"
#include "tests/engine/moving_scene.h"
#include "tests/store/server_process.h"

namespace clearance {
namespace {

using client::AckStatus;

[[noreturn]] void Die(const std::string& why) {
  std::cerr << "FAILED: " << why << std::endl;
  exit(1);
}

RegionEdit EditNumber(int n) {
  RegionEdit edit;
  edit.action = n % 3 == 0   ? RegionAction::kClearToUnknown
                : n % 3 == 1 ? RegionAction::kMarkOccupied
                             : RegionAction::kMarkFree;
  const Eigen::Vector3d low(-2.0 + 0.3 * (n % 9), 1.0, -0.5);
  edit.box = Aabb(low, low + Eigen::Vector3d(0.8, 0.5, 0.7));
  return edit;
}

// The frame as the server decodes it.
Frame OverTheWire(const Frame& frame) {
  v1::Frame message;
  wire::ToProto(frame, &message);
  absl::StatusOr<Frame> decoded = wire::FrameFromProto(message);
  if (!decoded.ok()) Die(std::string(decoded.status().message()));
  decoded->source_id = frame.source_id;
  return *std::move(decoded);
}

class Run {
 public:
  Run(const std::string& binary, int rounds, uint32_t seed, const std::string& sync)
      : folder_(std::filesystem::temp_directory_path() /
                ("clearance_kills_" + std::to_string(getpid()))),
        socket_(folder_ / "socket"),
        rounds_(rounds),
        random_(seed),
        server_(binary, {"--listen", "127.0.0.1:0",
                         "--socket", socket_,
                         "--http",   "off",
                         "--store",  folder_ / "data",
                         "--set",    "map.voxel_size_m=0.15",
                         "--set",    "map.max_distance_m=2",
                         "--set",    "map.object_lost_after_s=0.2",
                         "--set",    "store.segment_bytes=300000",
                         "--set",    "store.snapshot_period_s=0.35",
                         "--set",    "store.keep_snapshots=2",
                         "--set",    "store.fsync=" + sync},
                folder_ / "log") {
    std::filesystem::create_directories(folder_);
    config_.voxel_size_m = 0.15;
    config_.max_distance_m = 2;
    config_.object_lost_after_s = 0.2;
  }
  ~Run() {
    server_.Kill();
    std::filesystem::remove_all(folder_);
  }

  void Go() {
    server_.Start();
    std::thread sender([this] { Send(); });
    for (int round = 0; round < rounds_; ++round) {
      const uint64_t at_least = newest_acked_;
      AwaitServer(at_least);
      absl::SleepFor(absl::Milliseconds(random_() % 700));
      // Every third kill hits a snapshot that was just asked for.
      std::thread snapshot;
      if (round % 3 == 0) {
        snapshot = std::thread([this, round] { AskForSnapshot(round); });
        absl::SleepFor(absl::Milliseconds(random_() % 60));
      }
      {
        std::lock_guard lock(up_);
        server_.Kill();
        server_.Start();
      }
      if (snapshot.joinable()) snapshot.join();
    }
    AwaitServer(newest_acked_);
    stop_ = true;
    sender.join();
    const size_t twice = Compare();
    std::cout << rounds_ << " of " << rounds_ << " kills survived: " << sent_ << " frames and "
              << edits_.size() << " edits, " << acked_.size() << " acknowledged, 0 lost, " << twice
              << " applied twice, " << reconnects_
              << " reconnects; the recovered map equals an undisturbed run's, byte for byte"
              << std::endl;
  }

 private:
  std::unique_ptr<client::EsdfClient> Connect() const {
    client::ClientOptions options;
    options.address = socket_;
    options.connect_timeout = absl::Seconds(60);
    options.call_timeout = absl::Seconds(20);
    auto connected = client::EsdfClient::Connect(options);
    return connected.ok() ? *std::move(connected) : nullptr;
  }

  // Until it serves; what was acknowledged before must be there.
  void AwaitServer(uint64_t at_least) {
    const auto channel = client::OpenChannel(socket_, {}, absl::Seconds(60));
    if (!channel.ok()) Die("the server does not come back: " + LogText());
    const auto stub = v1::MapService::NewStub(*channel);
    for (int attempt = 0; attempt < 600; ++attempt) {
      grpc::ClientContext context;
      v1::GetMapResponse response;
      const grpc::Status status = stub->GetMap(&context, {}, &response);
      if (status.ok()) {
        uint64_t last = 0;
        for (const auto& source : response.info().sources()) last = source.last_frame_id();
        if (last < at_least) {
          Die("frame " + std::to_string(at_least) + " was acknowledged, the server stands at " +
              std::to_string(last));
        }
        return;
      }
      if (status.error_code() != grpc::StatusCode::UNAVAILABLE &&
          status.error_code() != grpc::StatusCode::NOT_FOUND) {
        Die(status.error_message());
      }
      absl::SleepFor(absl::Milliseconds(100));
    }
    Die("the server does not serve: " + LogText());
  }

  std::string LogText() const { return ReadFile(folder_ / "log").value_or("(no log)"); }

  void AskForSnapshot(int round) {
    const auto connected = Connect();
    if (connected) connected->CreateSnapshot("", "asked-" + std::to_string(round)).IgnoreError();
  }

  void OnAck(const client::FrameAck& ack) {
    std::lock_guard lock(acks_);
    if (ack.status == AckStatus::kRejected || ack.status == AckStatus::kDropped) {
      Die("frame " + std::to_string(ack.frame_id) +
          " was refused: " + (ack.violations.empty() ? "" : ack.violations[0].description));
    }
    acked_.insert(ack.frame_id);
    if (ack.status == AckStatus::kIntegrated) ++integrated_[ack.frame_id];
    newest_acked_ = std::max<uint64_t>(newest_acked_, ack.frame_id);
  }

  std::unique_ptr<client::IngestStream> OpenStream() {
    client::IngestOptions options;
    options.source_id = "camera";
    options.reconnect_for = absl::Minutes(3);
    options.max_backoff = absl::Milliseconds(200);
    options.on_ack = [this](const client::FrameAck& ack) { OnAck(ack); };
    for (int attempt = 0; attempt < 1000; ++attempt) {
      if (const auto connected = Connect()) {
        auto stream = connected->OpenIngest(options);
        if (stream.ok()) return *std::move(stream);
      }
      absl::SleepFor(absl::Milliseconds(50));
    }
    Die("no stream can be opened");
  }

  // Frames for ever; now and then, when all are settled, an edit.
  void Send() {
    int next = 0;
    while (!stop_) {
      auto stream = OpenStream();
      const uint64_t settled = stream->last_frame_id().value_or(0);
      if (settled != static_cast<uint64_t>(next)) Die("the stream stands at another frame");
      for (int k = 0; k < 20 && !stop_; ++k, ++next) {
        const absl::Status sent = stream->Send(MovingSceneFrame(next));
        if (!sent.ok()) Die(sent.ToString());
      }
      const absl::Status finished = stream->Finish();
      if (!finished.ok()) Die(finished.ToString());
      reconnects_ += stream->reconnects();
      sent_ = next;
      if (static_cast<uint64_t>(next) > settled) Edit(next);
    }
  }

  // The killer waits meanwhile: an edit whose answer is lost could not be told from one that never
  // came.
  void Edit(int after) {
    std::lock_guard lock(up_);
    const RegionEdit edit = EditNumber(after);
    wire::EditRegion request;
    request.box = edit.box;
    request.action = edit.action == RegionAction::kMarkFree ? v1::EDIT_ACTION_MARK_FREE
                     : edit.action == RegionAction::kMarkOccupied
                         ? v1::EDIT_ACTION_MARK_OCCUPIED
                         : v1::EDIT_ACTION_CLEAR_TO_UNKNOWN;
    const auto connected = Connect();
    if (!connected) Die("no connection for an edit");
    absl::StatusOr<client::MapStamp> done = connected->EditRegion("", request);
    while (absl::IsUnavailable(done.status()) || absl::IsNotFound(done.status())) {
      absl::SleepFor(absl::Milliseconds(50));  // still loading
      done = connected->EditRegion("", request);
    }
    if (!done.ok()) Die(done.status().ToString());
    edits_.insert(after);
  }

  // The final snapshot's files against those of a map made here of the same frames and edits.
  size_t Compare() {
    const auto connected = Connect();
    const auto made = connected->CreateSnapshot("", "final");
    if (!made.ok()) Die(made.status().ToString());
    if (server_.Terminate() != 0) Die("the server did not stop well");
    LiveMap undisturbed(config_);
    for (int k = 0; k < sent_; ++k) {
      const auto integrated = undisturbed.Integrate(OverTheWire(MovingSceneFrame(k)));
      if (!integrated.ok()) Die(integrated.status().ToString());
      if (edits_.contains(k + 1)) undisturbed.Edit(EditNumber(k + 1)).IgnoreError();
    }
    const std::string snapshot = folder_ / "data/maps/default/snapshots/final/";
    const absl::Status same = undisturbed.Freeze()->Write(
        [&](std::string_view name, std::string expected) -> absl::Status {
          absl::StatusOr<std::string> got = ReadFile(snapshot + std::string(name));
          if (!got.ok()) return got.status();
          if (name.ends_with(".vdb")) {  // OpenVDB gives each file a random id
            for (std::string* bytes : {&*got, &expected})
              bytes->replace(21, 36, std::string(36, '-'));
          }
          return *got == expected ? absl::OkStatus()
                                  : absl::InternalError(std::string(name) + " differs");
        });
    if (!same.ok()) Die(std::string(same.message()));
    size_t twice = 0;
    for (const auto& [id, count] : integrated_) twice += count > 1;
    if (twice > 0) Die(std::to_string(twice) + " frames were integrated twice");
    return twice;
  }

  const std::filesystem::path folder_;
  const std::string socket_;
  const int rounds_;
  std::mt19937 random_;
  ServerProcess server_;
  MapConfig config_;
  std::mutex up_;  // held while the server is killed and started, and during edits
  std::atomic<bool> stop_ = false;
  std::atomic<uint64_t> newest_acked_ = 0;
  std::atomic<int> sent_ = 0;
  uint64_t reconnects_ = 0;  // sender's
  std::set<int> edits_;      // after how many frames; sender's
  std::mutex acks_;
  std::set<uint64_t> acked_;
  std::map<uint64_t, int> integrated_;
};

}  // namespace
}  // namespace clearance

int main(int argc, char** argv) {
  CLI::App app("Kills a server at random moments and compares what it recovers.");
  std::string binary, sync = "interval";
  int rounds = 50;
  uint32_t seed = 1;
  app.add_option("server", binary)->required();
  app.add_option("--rounds", rounds);
  app.add_option("--seed", seed);
  app.add_option("--sync", sync);
  CLI11_PARSE(app, argc, argv);
  clearance::Run(binary, rounds, seed, sync).Go();
  return 0;
}
