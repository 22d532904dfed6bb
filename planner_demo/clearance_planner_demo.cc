// clearance_planner_demo: a robot plans through moving traffic on a map that a server keeps.

#include <ompl/util/Console.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>
#include <string>

#include "absl/strings/str_format.h"
#include "planner_demo/episode/course.h"
#include "planner_demo/episode/drive_log.h"
#include "planner_demo/episode/episode.h"
#include "planner_demo/episode/recording.h"
#include "planner_demo/episode/report.h"
#include "planner_demo/episode/sensor_rig.h"
#include "planner_demo/episode/server_process.h"

namespace clearance::demo {
namespace {

struct Arguments {
  std::string scene = "crossing";
  uint64_t seed = 7;
  int episodes = 20;
  bool json = false;
  bool quiet = false;
  std::vector<std::string> baselines = {"all"};
  std::string server_binary;
  std::string out;
  std::string recorded;
  bool remote = false;
};

constexpr Row kRows[] = {Row::kClearance, Row::kFrozenSnapshot, Row::kStaticFusion,
                         Row::kStraightAhead};

bool Wants(const Arguments& arguments, Row row) {
  if (row == Row::kClearance) return true;
  for (const std::string& name : arguments.baselines) {
    if (name == "all" || name == NameOf(row)) return true;
  }
  return false;
}

// A simulated drive with all it needs.
struct Simulated {
  Course course;
  std::unique_ptr<Truth> truth;
  std::unique_ptr<SensorRig> rig;
  Stage stage;
};

absl::StatusOr<std::unique_ptr<Simulated>> Simulate(const std::string& scene, uint64_t seed) {
  auto course = MakeCourse(scene, seed);
  if (!course.ok()) return course.status();
  auto drive = std::make_unique<Simulated>();
  drive->course = *std::move(course);
  drive->truth = TruthOf(drive->course.scene);
  drive->rig = std::make_unique<SensorRig>(drive->course.scene, RigNoise(), seed);
  drive->stage = StageOf(drive->course, *drive->rig, *drive->truth, seed);
  return drive;
}

// How much a picture of these drives tells: ours arrives, others do not.
int Tells(const std::vector<EpisodeResult>& drives) {
  int score = 0;
  for (const EpisodeResult& drive : drives) {
    if (drive.row == Row::kClearance) {
      score += drive.in_time ? 8 : 0;
    } else {
      score += drive.verdict.collision ? 2 : drive.in_time ? 0 : 1;
    }
  }
  return score;
}

// The logs of the seed that tells most stay in OUT, a folder a row.
class Showcase {
 public:
  explicit Showcase(std::string out) : out_(std::move(out)) {}
  bool wanted() const { return !out_.empty(); }
  std::string FolderFor(Row row) const { return out_ + "/.newest/" + NameOf(row); }
  void Offer(const std::vector<EpisodeResult>& drives) {
    namespace fs = std::filesystem;
    if (!wanted()) return;
    const int score = Tells(drives);
    if (score > best_) {
      best_ = score;
      for (const EpisodeResult& drive : drives) {
        const fs::path to = fs::path(out_) / NameOf(drive.row);
        fs::remove_all(to);
        fs::rename(FolderFor(drive.row), to);
      }
    }
    fs::remove_all(fs::path(out_) / ".newest");
  }

 private:
  const std::string out_;
  int best_ = -1;
};

absl::Status Run(const Arguments& arguments) {
  auto server = ServerProcess::Start(arguments.server_binary);
  if (!server.ok()) return server.status();
  client::ClientOptions client_options;
  client_options.address = (*server)->address();
  client_options.connect_timeout = absl::Seconds(30);
  const auto client = client::EsdfClient::Connect(client_options);
  if (!client.ok()) return client.status();

  std::vector<std::vector<EpisodeResult>> results(std::size(kRows));
  Showcase showcase(arguments.out);
  std::unique_ptr<Recording> recording;
  if (!arguments.recorded.empty()) {
    auto opened = Recording::Open(arguments.recorded);
    if (!opened.ok()) return opened.status();
    recording = *std::move(opened);
  }
  for (int i = 0; i < arguments.episodes; ++i) {
    const uint64_t seed = arguments.seed + static_cast<uint64_t>(i);
    std::unique_ptr<Simulated> simulated;
    if (recording == nullptr) {
      auto made = Simulate(arguments.scene, seed);
      if (!made.ok()) return made.status();
      simulated = *std::move(made);
    }
    const Stage stage = simulated ? simulated->stage : recording->StageFor(i);
    std::vector<EpisodeResult> drives;
    for (size_t r = 0; r < std::size(kRows); ++r) {
      if (!Wants(arguments, kRows[r])) continue;
      EpisodeOptions options;
      options.row = kRows[r];
      options.source = arguments.remote ? Source::kRemote : Source::kMirror;
      std::unique_ptr<DriveLog> log;
      if (showcase.wanted()) {
        log = std::make_unique<DriveLog>(showcase.FolderFor(kRows[r]), stage,
                                         simulated ? &simulated->course.scene : nullptr);
        options.observer = [&](const Moment& moment) { log->Add(moment, client->get()); };
      }
      auto result = RunEpisode(stage, client->get(), options);
      if (!result.ok()) return result.status();
      if (log != nullptr) {
        const absl::Status logged = log->Finish(*result);
        if (!logged.ok()) return logged;
      }
      drives.push_back(*result);
      if (!arguments.quiet) {
        std::cerr << absl::StrFormat("%s %d, %-15s %s (closest %.2f m)\n",
                                     simulated ? "seed" : "drive", stage.seed, NameOf(kRows[r]),
                                     result->outcome, result->verdict.min_clearance_m);
      }
      results[r].push_back(*std::move(result));
    }
    showcase.Offer(drives);
  }
  std::vector<RowSummary> rows;
  for (const auto& row : results) {
    if (!row.empty()) rows.push_back(Summarise(row));
  }
  if (arguments.json) {
    std::cout << ToJson(rows).dump(2) << "\n";
  } else {
    std::cout << Table(rows);
  }
  return absl::OkStatus();
}

}  // namespace
}  // namespace clearance::demo

int main(int argc, char** argv) {
  using clearance::demo::Arguments;
  Arguments arguments;
  arguments.server_binary =
      (std::filesystem::path(argv[0]).parent_path() / "clearance_server").string();
  CLI::App app("Drives a robot through simulated traffic, planned on a map that a server keeps.");
  app.add_option("--scene", arguments.scene, "what to drive through")
      ->check(CLI::IsMember(clearance::demo::CourseNames()))
      ->capture_default_str();
  app.add_option("--seed", arguments.seed, "of the first episode; each next one adds 1")
      ->capture_default_str();
  app.add_option("--episodes", arguments.episodes, "how many")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--baseline", arguments.baselines, "which other rows to drive")
      ->check(CLI::IsMember({"all", "none", "frozen_snapshot", "static_fusion", "straight_ahead"}))
      ->capture_default_str();
  app.add_option("--recorded", arguments.recorded,
                 "a recorded crossing's folder, with gt/, instead of a simulated scene");
  app.add_flag("--json", arguments.json, "print one JSON object instead of the table");
  app.add_flag("--remote", arguments.remote,
               "ask the server at every look-up instead of a mirror of its map");
  app.add_flag("--quiet", arguments.quiet, "no line an episode on stderr");
  app.add_option("--out", arguments.out,
                 "a folder for the drives of the seed that tells most, for drive_pictures.py");
  app.add_option("--server-binary", arguments.server_binary, "the server to start")
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  ompl::msg::noOutputHandler();
  const absl::Status status = clearance::demo::Run(arguments);
  if (status.ok()) return 0;
  std::fprintf(stderr, "clearance_planner_demo: %s\n", std::string(status.message()).c_str());
  return 1;
}
