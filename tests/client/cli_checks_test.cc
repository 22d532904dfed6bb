// What `clearance top` and `clearance doctor` compute.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "absl/time/clock.h"
#include "client/cli/doctor.h"
#include "client/cli/rates.h"

namespace clearance::cli {
namespace {

using ::testing::HasSubstr;

client::ServerStats Counters(uint64_t frames, uint64_t calls) {
  client::ServerStats stats;
  stats.uptime_s = 10;
  stats.maps.emplace_back().map = "yard";
  stats.maps[0].frames_integrated = frames;
  stats.calls.push_back({"QueryPoints", calls, 0, 0, 0, 0, 0});
  return stats;
}

TEST(Rates, CountBetweenTwoLooks) {
  Rates rates;
  const Rates::Clock::time_point start{};
  rates.Take(Counters(50, 200), start);
  EXPECT_DOUBLE_EQ(rates.Of("map yard"), 5);  // since the start, 10 s ago
  rates.Take(Counters(70, 200), start + std::chrono::seconds(2));
  EXPECT_DOUBLE_EQ(rates.Of("map yard"), 10);
  EXPECT_DOUBLE_EQ(rates.Of("call QueryPoints"), 0);
  EXPECT_DOUBLE_EQ(rates.Of("map hall"), 0);
  rates.Take(Counters(6, 3), start + std::chrono::seconds(4));  // the server was started anew
  EXPECT_DOUBLE_EQ(rates.Of("map yard"), 3);
  EXPECT_DOUBLE_EQ(rates.Of("call QueryPoints"), 1.5);
}

TEST(Doctor, ReadsCertificates) {
  const std::string folder = ::testing::TempDir() + "doctor_" + std::to_string(getpid());
  std::filesystem::create_directories(folder);
  const std::string pem = folder + "/c.pem";
  ASSERT_EQ(
      std::system(("openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes "
                   "-days 100 -subj /CN=x -keyout " +
                   folder + "/c.key -out " + pem + " 2>/dev/null")
                      .c_str()),
      0);
  const absl::Time now = absl::Now();
  EXPECT_EQ(CheckCertificate(pem, now + absl::Hours(1)).level, Finding::kGood);
  EXPECT_EQ(CheckCertificate(pem, now + absl::Hours(24 * 90)).level, Finding::kWarning);
  EXPECT_EQ(CheckCertificate(pem, now + absl::Hours(24 * 101)).level, Finding::kBad);
  EXPECT_EQ(CheckCertificate(pem, now - absl::Hours(24)).level, Finding::kBad);
  EXPECT_EQ(CheckCertificate(folder + "/none.pem", now).level, Finding::kBad);
  EXPECT_EQ(CheckCertificate(folder + "/c.key", now).level, Finding::kBad);
  std::filesystem::remove_all(folder);
}

TEST(Doctor, FindsWhatIsWrongWithAServer) {
  client::ServerInfo info;
  info.version = "9.9.9";
  info.draining = true;
  client::ServerStats stats = Counters(90, 0);
  stats.maps[0].frames_rejected = 10;
  std::vector<Finding> findings = CheckServer(info, stats);
  ASSERT_EQ(findings.size(), 3u);
  for (const Finding& finding : findings) EXPECT_EQ(finding.level, Finding::kWarning);
  EXPECT_THAT(findings[0].text, HasSubstr("9.9.9"));
  EXPECT_THAT(findings[2].text, HasSubstr("10 of 100 frames were rejected"));
  stats.maps[0].frames_rejected = 0;
  stats.maps[0].queue_length = stats.maps[0].queue_capacity = 8;
  EXPECT_THAT(CheckServer(info, stats)[2].text, HasSubstr("queue is full"));
  stats.maps[0].queue_length = 0;
  EXPECT_EQ(CheckServer(info, stats)[2].level, Finding::kGood);
}

TEST(Doctor, LooksAtDisks) {
  EXPECT_NE(CheckDisk(::testing::TempDir()).level, Finding::kBad);
  EXPECT_EQ(CheckDisk("/nowhere/at/all").level, Finding::kBad);
}

}  // namespace
}  // namespace clearance::cli
