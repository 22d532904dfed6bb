// The command line and the Python example against a running server, as a user runs them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/client/live_server.h"

namespace clearance::client {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

struct Outcome {
  int exit_code = -1;
  std::string out;
};

Outcome Shell(const std::string& command) {
  Outcome run;
  std::FILE* pipe = popen(command.c_str(), "r");
  char buffer[4096];
  for (size_t n; (n = fread(buffer, 1, sizeof(buffer), pipe)) > 0;) run.out.append(buffer, n);
  const int status = pclose(pipe);
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return run;
}

// One server for the file: a room with a moving object as a sequence folder, streamed in once.
class LiveCommand : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    server_ = new LiveServer();
    ASSERT_NE(server_->Connect(), nullptr);
    const TestFolder& folder = server_->folder();
    folder.Write("room/sequence.json", R"({"frame_count": 6, "voxel_size_m": 0.1,
      "sensor": {"type": "lidar", "max_range_m": 20}})");
    std::string trajectory, motions = "frame,object_id,tx,ty,tz,qx,qy,qz,qw\n";
    for (int i = 0; i < 6; ++i) {
      trajectory += std::to_string(i * 0.1) + " 0 0 0 0 0 0 1\n";
      if (i > 0) motions += std::to_string(i) + ",7,0.1,0,0,0,0,0,1\n";
      const Frame frame = RoomFrame(i, true);
      const auto& cloud = std::get<PointCloud>(frame.observation);
      folder.Write("room/cloud/00000" + std::to_string(i) + ".ply",
                   PlyCloud({cloud.points_X.data(), cloud.points_X.data() + cloud.points_X.size()},
                            cloud.labels));
    }
    folder.Write("room/trajectory.tum", trajectory);
    folder.Write("room/object_motions.csv", motions);
    const Outcome run = Clearance("ingest --json " + Path("room"));
    ASSERT_EQ(run.exit_code, 0) << run.out;
    const Json summary = Json::parse(run.out);
    ASSERT_EQ(summary["map"], "room");
    ASSERT_EQ(summary["integrated"], 6);
    ASSERT_EQ(summary["violations"], 0);
  }
  static void TearDownTestSuite() {
    EXPECT_EQ(server_->Terminate(), 0);
    delete server_;
    server_ = nullptr;
  }

  static std::string Path(const std::string& name) {
    return (server_->folder().path() / name).string();
  }
  // Standard error goes where the test can show it.
  static Outcome Clearance(const std::string& arguments) {
    return Shell("CLEARANCE_SERVER=" + server_->address() + " " CLEARANCE_COMMAND " " + arguments +
                 " 2>" + Path("err") + " </dev/null");
  }
  static std::string Err() { return server_->folder().Read("err"); }

  static LiveServer* server_;
};

LiveServer* LiveCommand::server_ = nullptr;

TEST_F(LiveCommand, HealthIsZeroWhileServing) {
  EXPECT_EQ(Clearance("health").exit_code, 0);
  EXPECT_EQ(Json::parse(Clearance("health --json").out)["serving"], true);
  EXPECT_EQ(Clearance("health --service no.such.Service").exit_code, 3);
}

TEST_F(LiveCommand, IngestAgainHasNothingToSend) {
  const Outcome run = Clearance("ingest --json " + Path("room"));
  ASSERT_EQ(run.exit_code, 0) << Err();
  EXPECT_EQ(Json::parse(run.out)["resumed_behind"], 6);
  EXPECT_EQ(Json::parse(run.out)["integrated"], 0);
  EXPECT_THAT(Clearance("ingest " + Path("room")).out, HasSubstr("nothing to send"));
}

TEST_F(LiveCommand, QueryAnswersOnePointAsTableAndJson) {
  const Outcome table = Clearance("query --map room -2 0 -0.5");
  ASSERT_EQ(table.exit_code, 0) << Err();
  EXPECT_THAT(table.out, HasSubstr("distance"));
  const Json json = Json::parse(Clearance("--map room query -2.0 0 0 --json").out);
  EXPECT_NEAR(json["answers"][0]["distance_m"].get<double>(), 1.0, 0.06);
  EXPECT_EQ(json["answers"][0]["state"], "free");
  EXPECT_EQ(json["answers"][0]["object_id"], 0);
  const Json near = Json::parse(Clearance("query 1 0 0 --map room --json").out);
  EXPECT_EQ(near["answers"][0]["object_id"], 7);
  const double now = near["answers"][0]["distance_m"];
  const Json ahead = Json::parse(Clearance("query 1 0 0 --map room --json --horizon 0.3").out);
  EXPECT_NEAR(ahead["answers"][0]["distance_m"].get<double>(), now + 0.3, 0.1);
  EXPECT_EQ(Clearance("query 1 0 0 --map room --horizon 100").exit_code, 4);
  EXPECT_EQ(Clearance("query 1 0 0 --map nowhere").exit_code, 3);
  EXPECT_THAT(Err(), HasSubstr("nowhere"));
}

TEST_F(LiveCommand, QueryAnswersAFileOfPoints) {
  std::string csv = "x,y,z\n";
  for (int i = 0; i < 1000; ++i) csv += std::to_string(-2.5 + i * 0.001) + ",0.5,0\n";
  server_->folder().Write("points.csv", csv);
  const Outcome run = Clearance("query --map room --points " + Path("points.csv") + " --out " +
                                Path("answers.csv"));
  ASSERT_EQ(run.exit_code, 0) << Err();
  std::ifstream answers(Path("answers.csv"));
  std::string line;
  std::getline(answers, line);
  EXPECT_EQ(line.substr(0, 16), "x,y,z,distance_m");
  int lines = 0;
  while (std::getline(answers, line)) ++lines;
  EXPECT_EQ(lines, 1000);
}

TEST_F(LiveCommand, CheckTellsWhetherAPathIsFree) {
  const std::string robot = "check --map room --radius 0.3 --unknown-free ";
  const Json hit =
      Json::parse(Clearance(robot + "--from -2 0 0 --to -2.95 0 0 --duration 2 --json").out);
  EXPECT_EQ(hit["collides"], true) << Err();
  EXPECT_NEAR(hit["first_collision_s"].get<double>(), 2 * 0.7 / 0.95, 0.15);
  EXPECT_EQ(hit["object_id"], 0);
  server_->folder().Write("path.csv", "t,x,y,z\n0,-2,0,0\n1,-2,0.5,0\n");
  const Outcome free = Clearance(robot + "--path " + Path("path.csv"));
  EXPECT_EQ(free.exit_code, 0) << Err();
  EXPECT_THAT(free.out, HasSubstr("is free"));
  EXPECT_EQ(Clearance(robot + "--from 0 0 0 --to 1 0 0 --duration 100").exit_code, 4);
  EXPECT_THAT(Err(), HasSubstr("trajectories[0].times_f64[1]"));
  EXPECT_EQ(Clearance("check --map room --from 0 0 0 --to 1 0 0").exit_code, 2);
  EXPECT_EQ(Clearance("check --map room --radius 0.3").exit_code, 2);
}

TEST_F(LiveCommand, ObjectsListsTheMovingBox) {
  const Json json = Json::parse(Clearance("objects --map room --json --trajectory").out);
  ASSERT_EQ(json["objects"].size(), 1u);
  EXPECT_EQ(json["objects"][0]["object_id"], 7);
  EXPECT_EQ(json["objects"][0]["trajectory"].size(), 6u);
  EXPECT_NEAR(json["objects"][0]["speed_mps"].get<double>(), 1.0, 0.05);
  EXPECT_THAT(Clearance("objects --map room").out, HasSubstr("tracked"));
}

TEST_F(LiveCommand, InfoTellsOfServerMapAndSource) {
  const Json json = Json::parse(Clearance("info --map room --json").out);
  EXPECT_EQ(json["map"], "room");
  EXPECT_EQ(json["stamp"]["revision"], 6);
  EXPECT_EQ(json["sources"][0]["source_id"], "room");
  EXPECT_NEAR(json["config"]["voxel_size_m"].get<double>(), 0.1, 1e-12);
  EXPECT_THAT(Clearance("info --map room").out, HasSubstr("revision"));
}

TEST_F(LiveCommand, BenchCountsCallsAndKeepsTheirLatencies) {
  const Outcome run =
      Clearance("bench query --map room --points 200 --clients 2 --seconds 0.3 --edges --json");
  ASSERT_EQ(run.exit_code, 0) << Err();
  const Json json = Json::parse(run.out);
  const Json& latency = json["latency"];
  EXPECT_GT(latency["count"].get<int>(), 2);
  EXPECT_LE(latency["p50_ms"].get<double>(), latency["p99_ms"].get<double>());
  EXPECT_LE(latency["p99_ms"].get<double>(), latency["max_ms"].get<double>());
  int binned = 0;
  for (const Json& bin : latency["histogram"]) binned += bin["count"].get<int>();
  EXPECT_EQ(binned, latency["count"].get<int>());
  // 20 calls a second and client for 0.5 s, whatever the server does.
  const Json paced =
      Json::parse(Clearance("bench query --map room --rate 20 --seconds 0.5 --json").out);
  EXPECT_EQ(paced["latency"]["count"], 10);
  EXPECT_THAT(Clearance("bench query --map room --seconds 0.1").out, HasSubstr("calls/s"));
  EXPECT_EQ(Clearance("bench query --map nowhere --seconds 0.1").exit_code, 3);
}

TEST_F(LiveCommand, BenchIngestsIntoAMapOfItsOwnAndLeavesNone) {
  const auto maps = [] {
    std::vector<std::string> names;
    const auto client = server_->Connect();
    const auto listed = client->ListMaps();
    for (const MapInfo& info : *listed) names.push_back(info.map);
    return names;
  };
  const auto before = maps();
  const Outcome run = Clearance("bench ingest --json " + Path("room"));
  ASSERT_EQ(run.exit_code, 0) << Err();
  const Json json = Json::parse(run.out);
  EXPECT_EQ(json["sent_to_integrated"]["count"], 6);
  EXPECT_EQ(json["not_integrated"], 0);
  EXPECT_GE(json["sent_to_integrated"]["max_ms"].get<double>(),
            json["integration"]["max_ms"].get<double>());
  EXPECT_EQ(maps(), before);
  EXPECT_EQ(Clearance("bench ingest /no/such/folder").exit_code, 3);
}

TEST_F(LiveCommand, WatchPrintsALineForWhatTheMapTells) {
  const Outcome text = Clearance("watch --map room --count 1");
  EXPECT_EQ(text.exit_code, 0) << text.out;
  EXPECT_THAT(text.out, HasSubstr("checkpoint"));
  EXPECT_THAT(text.out, HasSubstr("revision      6"));
  const Outcome run = Clearance("watch --map room --count 1 --json");
  ASSERT_EQ(run.exit_code, 0) << run.out;
  const Json line = Json::parse(run.out);
  EXPECT_EQ(line["kind"], "checkpoint");
  EXPECT_EQ(line["stamp"]["revision"], 6);
  EXPECT_GT(line["blocks"], 10);
  EXPECT_GT(line["block_bytes"], 1000);
  ASSERT_EQ(line["objects"].size(), 1u);
  EXPECT_EQ(line["objects"][0]["object_id"], 7);
  const Outcome poses = Clearance("watch --map room --count 1 --json --poses-only");
  EXPECT_EQ(Json::parse(poses.out)["blocks"], 0);
  EXPECT_EQ(Clearance("watch --map nowhere").exit_code, 3);
  EXPECT_EQ(Clearance("watch --max-rate -1").exit_code, 2);
}

TEST_F(LiveCommand, SliceDrawsAPicture) {
  const Outcome run = Clearance("slice --map room --z 0.1 --json --out " + Path("slice.png"));
  ASSERT_EQ(run.exit_code, 0) << Err();
  const Json json = Json::parse(run.out);
  EXPECT_GT(json["cells"]["free"].get<int>(), 2000);
  EXPECT_GT(json["cells"]["occupied"].get<int>(), 150);
  EXPECT_EQ(server_->folder().Read("slice.png").substr(1, 3), "PNG");
  EXPECT_EQ(Clearance("slice --map room --z 0.1 --out /no/such/folder/a.png").exit_code, 3);
}

TEST_F(LiveCommand, MeshAndGridAreFiles) {
  ASSERT_EQ(Clearance("mesh --map room --out " + Path("map.ply")).exit_code, 0) << Err();
  EXPECT_EQ(server_->folder().Read("map.ply").substr(0, 3), "ply");
  ASSERT_EQ(
      Clearance("mesh --map room --object 7 --object-frame --out " + Path("car.glb")).exit_code, 0)
      << Err();
  EXPECT_EQ(server_->folder().Read("car.glb").substr(0, 4), "glTF");
  EXPECT_EQ(Clearance("mesh --map room --object 8 --out " + Path("none.ply")).exit_code, 3);
  EXPECT_FALSE(std::filesystem::exists(Path("none.ply")));
  EXPECT_FALSE(std::filesystem::exists(Path("none.ply.part")));
  ASSERT_EQ(
      Clearance("grid --map room --kind mean --kind distance --out " + Path("map.vdb")).exit_code,
      0)
      << Err();
  EXPECT_GT(std::filesystem::file_size(Path("map.vdb")), 1000u);
}

TEST_F(LiveCommand, MapsAreMadeListedEditedAndForgotten) {
  ASSERT_EQ(Clearance("map create yard --voxel-size-m 0.25").exit_code, 0) << Err();
  EXPECT_EQ(Clearance("map create yard").exit_code, 4);
  EXPECT_THAT(Clearance("map list").out, HasSubstr("yard"));
  ASSERT_EQ(Clearance("map edit --map yard --action occupied --box -1 -1 -1 1 1 1").exit_code, 0)
      << Err();
  const Json json = Json::parse(Clearance("query 3 0 0 --map yard --json").out);
  EXPECT_NEAR(json["answers"][0]["distance_m"].get<double>(), 2.0, 0.26);
  ASSERT_EQ(Clearance("map delete yard").exit_code, 0) << Err();
  EXPECT_EQ(Clearance("map delete yard").exit_code, 3);
}

TEST_F(LiveCommand, AnotherVoxelSizeOrNoneIsAnErrorThatNamesTheFlag) {
  EXPECT_EQ(Clearance("ingest " + Path("room") + " --voxel-size-m 0.2").exit_code, 4);
  EXPECT_THAT(Err(), HasSubstr("--voxel-size-m"));
  std::filesystem::copy(Path("room"), Path("bare"), std::filesystem::copy_options::recursive);
  server_->folder().Write("bare/sequence.json",
                          R"({"frame_count": 6, "sensor": {"type": "lidar"}})");
  EXPECT_EQ(Clearance("ingest " + Path("bare")).exit_code, 4);
  EXPECT_THAT(Err(), HasSubstr("--voxel-size-m"));
  EXPECT_EQ(Clearance("ingest " + Path("bare") + " --voxel-size-m 0.2").exit_code, 0) << Err();
}

TEST_F(LiveCommand, ADamagedFrameEndsIngestBehindWhatCameBefore) {
  std::filesystem::copy(Path("room"), Path("damaged"), std::filesystem::copy_options::recursive);
  std::filesystem::resize_file(Path("damaged/cloud/000003.ply"), 1000);
  EXPECT_EQ(Clearance("ingest " + Path("damaged")).exit_code, 4);
  EXPECT_THAT(Err(), HasSubstr("cloud/000003.ply: ends at byte 1000"));
  EXPECT_EQ(Json::parse(Clearance("info --map damaged --json").out)["stamp"]["revision"], 3);
}

TEST_F(LiveCommand, ThePythonExampleRuns) {
  const Outcome run = Shell("PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=" CLEARANCE_PYTHON_PATH
                            " " CLEARANCE_PYTHON " client/python/example.py " +
                            server_->address() + " room 2>&1");
  EXPECT_EQ(run.exit_code, 0) << run.out;
  EXPECT_THAT(run.out, HasSubstr("in a second"));
}

TEST_F(LiveCommand, ThePythonClientIngestsAndMeasures) {
  const Outcome run = Shell("PYTHONDONTWRITEBYTECODE=1 PYTHONPATH=" CLEARANCE_PYTHON_PATH
                            " " CLEARANCE_PYTHON " tests/client/python_client_test.py " +
                            server_->address() + " 2>&1");
  EXPECT_EQ(run.exit_code, 0) << run.out;
}

TEST_F(LiveCommand, TopAndDoctorLookAtTheServer) {
  const Outcome top = Clearance("top --count 1 --json");
  ASSERT_EQ(top.exit_code, 0) << Err();
  const Json json = Json::parse(top.out);
  EXPECT_GT(json["resident_bytes"].get<uint64_t>(), 1'000'000u);
  bool room = false;
  for (const Json& map : json["maps"]) {
    if (map["map"] != "room") continue;
    room = true;
    EXPECT_EQ(map["frames_integrated"], 6);
    EXPECT_GT(map["frames_per_s"].get<double>(), 0);
  }
  EXPECT_TRUE(room);
  EXPECT_THAT(Clearance("top --count 1").out, HasSubstr("frames/s"));
  const Outcome doctor = Clearance("doctor --disk /tmp");
  EXPECT_EQ(doctor.exit_code, 0) << Err();
  EXPECT_THAT(doctor.out, HasSubstr("map room"));
  EXPECT_EQ(Clearance("doctor --certificate /no/such.pem").exit_code, 5);
}

TEST_F(LiveCommand, ANodeClientMadeFromTheProtosAloneAgrees) {
  if (Shell("node --version && npm --version").exit_code != 0) {
    GTEST_SKIP() << "node or npm is not installed";
  }
  std::filesystem::copy("client/node", Path("node"), std::filesystem::copy_options::recursive);
  const Outcome install = Shell("npm ci --prefix " + Path("node") + " --no-audit --no-fund 2>&1");
  if (install.exit_code != 0) GTEST_SKIP() << "npm cannot install: " << install.out;
  const Outcome run = Shell("CLEARANCE_PROTO=proto node " + Path("node/example.mjs") + " " +
                            server_->address() + " room 2>&1");
  ASSERT_EQ(run.exit_code, 0) << run.out;
  for (const char* point : {"10 2 0.5", "5 0 0.5"}) {
    for (const char* horizon : {"0", "1"}) {
      const Json json = Json::parse(
          Clearance(std::string("query ") + point + " --horizon " + horizon + " --map room --json")
              .out);
      char text[32];
      std::snprintf(text, sizeof(text), "%.2f m", json["answers"][0]["distance_m"].get<double>());
      EXPECT_THAT(run.out, HasSubstr(text)) << point << ", " << horizon << " s ahead";
    }
  }
}

}  // namespace
}  // namespace clearance::client
