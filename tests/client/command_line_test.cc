// The command as a user runs it, without a server.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/client/test_files.h"

namespace clearance::cli {
namespace {

using ::testing::HasSubstr;

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

Outcome Clearance(const std::string& arguments) {
  const client::TestFolder folder;
  const std::string err = (folder.path() / "err").string();
  // Nothing listens on port 1.
  const std::string command = "CLEARANCE_SERVER=127.0.0.1:1 " CLEARANCE_COMMAND " " + arguments +
                              " 2>" + err + " </dev/null";
  Outcome run;
  std::FILE* pipe = popen(command.c_str(), "r");
  char buffer[4096];
  for (size_t n; (n = fread(buffer, 1, sizeof(buffer), pipe)) > 0;) run.out.append(buffer, n);
  const int status = pclose(pipe);
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  run.err = folder.Read("err");
  return run;
}

TEST(CommandLine, WrongUseEndsWithTwoAndSaysWhatIsWrong) {
  for (const char* arguments : {"",
                                "fly",
                                "query",
                                "query 1 2",
                                "query 1 2 x",
                                "query 1 2 3 --points a.csv",
                                "slice --out a.png",
                                "slice --z 1 --out a.jpg",
                                "mesh --out a.stl",
                                "mesh --out a.ply --object-frame",
                                "mesh --out a.ply --object -1",
                                "ingest",
                                "ingest . --rate fast",
                                "ingest . --rate -1",
                                "ingest . --voxel-size-m 0",
                                "bench",
                                "bench query --points 0",
                                "bench query --bounds 1 2 3",
                                "bench query --rate -1",
                                "bench ingest",
                                "bench watch --clients 0",
                                "bench watch --max-rate -1",
                                "map",
                                "map create a --bounds 1 2 3",
                                "map edit --action burn",
                                "info --timeout 0",
                                "health --nonsense"}) {
    const Outcome run = Clearance(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments << "\n" << run.err;
    EXPECT_THAT(run.err, HasSubstr("clearance: ")) << arguments;
    EXPECT_EQ(run.out, "") << arguments;
  }
}

TEST(CommandLine, HelpAndVersionNeedNoServer) {
  EXPECT_EQ(Clearance("--help").exit_code, 0);
  EXPECT_THAT(Clearance("--help").out, HasSubstr("5 unavailable"));
  for (const char* command : {"ingest", "query", "objects", "info", "slice", "mesh", "grid",
                              "health", "map", "map create", "version"}) {
    const Outcome run = Clearance(std::string(command) + " --help");
    EXPECT_EQ(run.exit_code, 0) << command;
    EXPECT_THAT(run.out, HasSubstr("--help")) << command;
  }
  EXPECT_THAT(Clearance("version").out, HasSubstr("clearance 0."));
  EXPECT_EQ(nlohmann::json::parse(Clearance("version --json").out)["api_version"], "v1");
}

TEST(CommandLine, AServerThatIsNotThereIsFiveAndSaysWhereAndWhatToDo) {
  for (const char* arguments :
       {"health", "query 10 -2 0.5", "query 10 -2 -0.5 --horizon -1", "info", "objects",
        "slice --z -0.5 --out a.png", "mesh --out a.ply", "map list"}) {
    const Outcome run = Clearance(std::string("--timeout 1 ") + arguments);
    EXPECT_EQ(run.exit_code, 5) << arguments << "\n" << run.err;
    EXPECT_THAT(run.err, HasSubstr("127.0.0.1:1")) << arguments;
    EXPECT_THAT(run.err, HasSubstr("onnection refused")) << arguments;
    EXPECT_THAT(run.err, HasSubstr("clearance_server")) << arguments;
  }
  const Outcome run = Clearance("health --server /no/such/socket --timeout 1");
  EXPECT_EQ(run.exit_code, 5);
  EXPECT_THAT(run.err, HasSubstr("/no/such/socket"));
}

TEST(CommandLine, ErrorsAreJsonTooWhereAskedFor) {
  const Outcome run = Clearance("health --json --timeout 1");
  EXPECT_EQ(run.exit_code, 5);
  const auto json = nlohmann::json::parse(run.out);
  EXPECT_EQ(json["error"]["exit_code"], 5);
  EXPECT_EQ(json["error"]["code"], "UNAVAILABLE");
}

TEST(CommandLine, AnAddressThatCannotBeOneIsBadData) {
  const Outcome run = Clearance("health --server localhost");
  EXPECT_EQ(run.exit_code, 4);
  EXPECT_THAT(run.err, HasSubstr("got \"localhost\", expected HOST:PORT"));
}

TEST(CommandLine, MissingAndDamagedInputIsFoundBeforeTheServerIs) {
  EXPECT_EQ(Clearance("ingest /no/such/folder").exit_code, 3);
  EXPECT_THAT(Clearance("ingest /no/such/folder").err, HasSubstr("/no/such/folder"));
  client::TestFolder folder;
  client::WriteDepthSequence(folder);
  folder.Write("trajectory.tum", "0 0 0 0 0 0 0 1\n");
  const Outcome run = Clearance("ingest " + folder.path().string());
  EXPECT_EQ(run.exit_code, 4);
  EXPECT_THAT(run.err, HasSubstr("trajectory.tum: got 1 poses, expected 3"));
  EXPECT_EQ(Clearance("query --points /no/such/points.csv").exit_code, 3);
  folder.Write("points.csv", "x,y,z\n1,2,3\n4,5\n");
  const Outcome points = Clearance("query --points " + (folder.path() / "points.csv").string());
  EXPECT_EQ(points.exit_code, 4);
  EXPECT_THAT(points.err, HasSubstr("points.csv:3: got 2 cells"));
}

}  // namespace
}  // namespace clearance::cli
