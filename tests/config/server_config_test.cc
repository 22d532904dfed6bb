#include "server/config/server_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

namespace clearance {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string ErrorOf(const std::string& yaml) {
  ServerConfig config;
  const absl::Status status = ApplyYaml(yaml, "server.yaml", &config);
  return status.ok() ? "" : std::string(status.message());
}

TEST(ServerConfig, TheShippedFileHoldsExactlyTheDefaultsAndEveryKey) {
  ServerConfig config;
  config.map.voxel_size_m = 7;  // to see that the file really sets it
  ASSERT_TRUE(ApplyFile("server/config/default.yaml", &config).ok());
  EXPECT_TRUE(config.Validate().ok());
  const ServerConfig defaults;
  EXPECT_EQ(config.map.voxel_size_m, defaults.map.voxel_size_m);
  EXPECT_EQ(config.listen, defaults.listen);
  EXPECT_EQ(config.max_frame_points, defaults.max_frame_points);
  EXPECT_EQ(config.credits, defaults.credits);
  std::FILE* file = std::fopen("server/config/default.yaml", "r");
  ASSERT_NE(file, nullptr);
  std::string text(1 << 16, 0);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  for (const std::string& key : ConfigKeys()) {
    EXPECT_THAT(text, HasSubstr("\n  " + key.substr(key.find('.') + 1) + ":")) << key;
  }
}

TEST(ServerConfig, AnUnknownKeyIsAnErrorWithItsLineAndASuggestion) {
  EXPECT_THAT(ErrorOf("server:\n  http: off\nmap:\n  voxel_size: 0.2\n"),
              AllOf(HasSubstr("server.yaml:4:"), HasSubstr("'voxel_size'"),
                    HasSubstr("did you mean 'voxel_size_m'?")));
  EXPECT_THAT(ErrorOf("\nmaps:\n  voxel_size_m: 1\n"),
              AllOf(HasSubstr("server.yaml:2:"), HasSubstr("did you mean 'map'?")));
  EXPECT_THAT(ErrorOf("map:\n  entirely_something_else: 1\n"),
              AllOf(HasSubstr("server.yaml:2:"), ::testing::Not(HasSubstr("did you mean"))));
}

TEST(ServerConfig, LimitsOfChecksStreamsAndPinsAreKeys) {
  ServerConfig config;
  ASSERT_TRUE(ApplyYaml("limits:\n  max_trajectories: 7\n  max_waypoints: 70\n  max_spheres: 8\n"
                        "  max_region_cells: 900\n  max_stream_requests: 3\n  max_pins: 2\n"
                        "  pin_ttl_s: 1.5\n  max_pin_ttl_s: 4\n",
                        "server.yaml", &config)
                  .ok());
  EXPECT_TRUE(config.Validate().ok());
  EXPECT_EQ(config.max_trajectories, 7u);
  EXPECT_EQ(config.max_waypoints, 70u);
  EXPECT_EQ(config.max_spheres, 8u);
  EXPECT_EQ(config.max_region_cells, 900u);
  EXPECT_EQ(config.max_stream_requests, 3u);
  EXPECT_EQ(config.max_pins, 2u);
  EXPECT_EQ(config.pin_ttl_s, 1.5);
  EXPECT_EQ(config.max_pin_ttl_s, 4);
  config.pin_ttl_s = 5;  // beyond the largest
  EXPECT_THAT(std::string(config.Validate().message()), HasSubstr("limits.pin_ttl_s"));
}

TEST(ServerConfig, TheLogsFormatAndCallsAreKeys) {
  ServerConfig config;
  ASSERT_TRUE(ApplyYaml("log: {format: json, calls: all}", "server.yaml", &config).ok());
  EXPECT_EQ(config.log_format, ServerConfig::LogFormat::kJson);
  EXPECT_EQ(config.log_calls, ServerConfig::LogCalls::kAll);
  EXPECT_THAT(ErrorOf("log:\n  format: xml\n"), HasSubstr("text or json"));
  EXPECT_THAT(ErrorOf("log:\n  calls: some\n"), HasSubstr("none, failed or all"));
}

TEST(ServerConfig, WrongTypesRepeatsAndSyntaxErrorsNameTheirLine) {
  EXPECT_THAT(ErrorOf("map:\n  voxel_size_m: big\n"),
              AllOf(HasSubstr("server.yaml:2: map.voxel_size_m: got 'big', expected a number")));
  EXPECT_THAT(ErrorOf("map:\n  voxel_size_m: .nan\n"), HasSubstr("expected a number"));
  EXPECT_THAT(ErrorOf("limits:\n\n  max_maps: -3\n"), HasSubstr("server.yaml:3:"));
  EXPECT_THAT(ErrorOf("limits:\n  max_maps: 2.5\n"), HasSubstr("whole number"));
  EXPECT_THAT(ErrorOf("map:\n  overload_policy: panic\n"), HasSubstr("block or drop_oldest"));
  EXPECT_THAT(ErrorOf("map:\n  bounds: [[0, 0], [1, 1]]\n"), HasSubstr("two corners"));
  EXPECT_THAT(ErrorOf("map:\n  voxel_size_m: 1\n  voxel_size_m: 2\n"),
              AllOf(HasSubstr("server.yaml:3:"), HasSubstr("repeats")));
  EXPECT_THAT(ErrorOf("map: {}\nmap: {}\n"), HasSubstr("repeats"));
  EXPECT_THAT(ErrorOf("map:\n  - 1\n"), HasSubstr("keys and values"));
  EXPECT_THAT(ErrorOf("just text"), HasSubstr("server.yaml:1:"));
  EXPECT_THAT(ErrorOf("map: [1,\nserver: }\n"), HasSubstr("server.yaml:2:"));
  EXPECT_EQ(ErrorOf(""), "");
}

TEST(ServerConfig, ReadsEveryKindOfValue) {
  ServerConfig config;
  ASSERT_TRUE(ApplyYaml("server:\n  listen: [\"127.0.0.1:1\", \"[::1]:2\"]\n  socket: /run/c.sock\n"
                        "  allow_remote_plaintext: true\n"
                        "map:\n  bounds: [[-1, -2, -3], [1, 2, 3.5]]\n"
                        "  overload_policy: drop_oldest_static\n  create_default: false\n",
                        "x", &config)
                  .ok());
  EXPECT_THAT(config.listen, ElementsAre("127.0.0.1:1", "[::1]:2"));
  EXPECT_EQ(config.socket, "/run/c.sock");
  EXPECT_TRUE(config.allow_remote_plaintext);
  EXPECT_FALSE(config.create_default_map);
  ASSERT_TRUE(config.map.bounds);
  EXPECT_EQ(config.map.bounds->max().z(), 3.5);
  EXPECT_EQ(config.map.overload, OverloadPolicy::kDropOldestStatic);
}

TEST(ServerConfig, TheEnvironmentOverridesTheFile) {
  ServerConfig config;
  setenv("CLEARANCE_MAP_VOXEL_SIZE_M", "0.25", 1);
  setenv("CLEARANCE_LISTEN", "127.0.0.1:1, 127.0.0.1:2", 1);
  EXPECT_TRUE(ApplyEnvironment(&config).ok());
  EXPECT_EQ(config.map.voxel_size_m, 0.25);
  EXPECT_THAT(config.listen, ElementsAre("127.0.0.1:1", "127.0.0.1:2"));
  setenv("CLEARANCE_MAP_VOXEL_SIZE_M", "wide", 1);
  EXPECT_THAT(std::string(ApplyEnvironment(&config).message()),
              HasSubstr("CLEARANCE_MAP_VOXEL_SIZE_M: got 'wide'"));
  unsetenv("CLEARANCE_MAP_VOXEL_SIZE_M");
  unsetenv("CLEARANCE_LISTEN");
}

TEST(ServerConfig, ASettingNamesAnUnknownKey) {
  ServerConfig config;
  EXPECT_TRUE(ApplySetting("map.voxel_size_m", "0.5", "--set", &config).ok());
  EXPECT_EQ(config.map.voxel_size_m, 0.5);
  EXPECT_THAT(std::string(ApplySetting("map.voxel_sizem", "1", "--set", &config).message()),
              HasSubstr("did you mean 'map.voxel_size_m'?"));
}

TEST(ServerConfig, PlainTextIsForLoopbackUnlessAllowed) {
  ServerConfig config;
  for (const char* good : {"127.0.0.1:50051", "127.1.2.3:1", "localhost:0", "[::1]:9"}) {
    config.listen = {good};
    EXPECT_TRUE(config.Validate().ok()) << good << config.Validate();
  }
  for (const char* bad : {"0.0.0.0:50051", "192.168.0.2:1", "[::]:1", "example.org:1"}) {
    config.listen = {bad};
    EXPECT_THAT(std::string(config.Validate().message()), HasSubstr("plain text")) << bad;
    config.allow_remote_plaintext = true;
    EXPECT_TRUE(config.Validate().ok()) << bad;
    config.allow_remote_plaintext = false;
  }
  config.listen = {"127.0.0.1:1"};
  config.http = "0.0.0.0:8080";
  EXPECT_THAT(std::string(config.Validate().message()), HasSubstr("server.http"));
}

TEST(ServerConfig, ValidationNamesTheKeyAndItsRange) {
  ServerConfig config;
  config.map.voxel_size_m = 0;
  EXPECT_THAT(std::string(config.Validate().message()), HasSubstr("map.voxel_size_m"));
  config = {};
  config.worker_threads = 0;
  EXPECT_THAT(std::string(config.Validate().message()), HasSubstr("server.worker_threads"));
  config = {};
  config.listen.clear();
  EXPECT_FALSE(config.Validate().ok());
  config.socket = "/tmp/x.sock";
  EXPECT_TRUE(config.Validate().ok());
  config.socket = std::string(200, 'x');
  EXPECT_THAT(std::string(config.Validate().message()), HasSubstr("limit 107"));
}

TEST(ServerConfig, SplitsHostsAndPorts) {
  EXPECT_EQ(ParseHostPort("[::1]:80", "f")->host, "::1");
  EXPECT_EQ(ParseHostPort("a.b:0", "f")->port, 0);
  for (const char* bad : {"", "a", ":1", "a:", "a:x", "a:65536", "a:-1", "::1:80", "[]:1"}) {
    EXPECT_FALSE(ParseHostPort(bad, "f").ok()) << bad;
  }
}

}  // namespace
}  // namespace clearance
