#include "client/sequence/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/sequence/text.h"
#include "tests/client/test_files.h"

namespace clearance::client {
namespace {

using ::testing::HasSubstr;

TEST(Text, ReadsSecondsAsExactNanoseconds) {
  const struct {
    const char* text;
    int64_t ns;
  } cases[] = {{"0", 0},
               {"1317042272.349000", 1317042272349000000},
               {"1317042272.349000123", 1317042272349000123},
               {"0.033333", 33333000},
               {"-1.5", -1500000000},
               {"7.1234567899", 7123456789},
               {"3.", 3000000000}};
  for (const auto& c : cases) {
    int64_t ns = 0;
    EXPECT_TRUE(ParseSecondsAsNs(c.text, &ns)) << c.text;
    EXPECT_EQ(ns, c.ns) << c.text;
  }
  int64_t ns = 0;
  for (const char* bad : {"", ".5", "1e9", "1.2.3", "nan", "--1", "99999999999999", "1,5"}) {
    EXPECT_FALSE(ParseSecondsAsNs(bad, &ns)) << bad;
  }
}

TEST(Text, NumbersAreWholeAndFinite) {
  double value = 0;
  EXPECT_TRUE(ParseNumber("-1.5e3", &value));
  EXPECT_EQ(value, -1500);
  for (const char* bad : {"", "1x", "nan", "inf", "1 2", "0x10"}) {
    EXPECT_FALSE(ParseNumber(bad, &value)) << bad;
  }
}

TEST(Trajectory, ReadsPosesAndSkipsComments) {
  TestFolder folder;
  const auto path = folder.Write(
      "t.tum", "# a comment\n\n0.5 1 2 3 0 0 0.7071 0.7071\r\n 1.5\t-1 -2 -3 0 0 0 1\n");
  const auto trajectory = ReadTrajectory(path);
  ASSERT_TRUE(trajectory.ok()) << trajectory.status();
  ASSERT_EQ(trajectory->stamps_ns, (std::vector<int64_t>{500'000'000, 1'500'000'000}));
  const Eigen::Vector3d p_W = trajectory->T_W_X[0] * Eigen::Vector3d(1, 0, 0);
  EXPECT_LT((p_W - Eigen::Vector3d(1, 3, 3)).norm(), 1e-9);  // a quarter turn about z
}

TEST(Trajectory, NamesTheLineThatIsWrong) {
  const struct {
    const char* lines;
    const char* text;
  } cases[] = {{"0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0\n", ":2: got 7 values"},
               {"0 0 0 0 0 0 0 1\n\n0 0 0 0 0 0 0 1\n", ":3: got 0, expected a timestamp above"},
               {"0 0 0 0 0 0 0 1\n-1 0 0 0 0 0 0 1\n", ":2: got -1, expected a timestamp above"},
               {"0 0 0 0 0 0 0 0\n", ":1: got a quaternion of norm 0"},
               {"0 nan 0 0 0 0 0 1\n", ":1: got \"nan\""},
               {"abc 0 0 0 0 0 0 1\n", ":1: got \"abc\", expected a timestamp"}};
  for (const auto& c : cases) {
    TestFolder folder;
    const auto trajectory = ReadTrajectory(folder.Write("t.tum", c.lines));
    EXPECT_EQ(trajectory.status().code(), absl::StatusCode::kDataLoss) << c.lines;
    EXPECT_THAT(std::string(trajectory.status().message()), HasSubstr(c.text));
    EXPECT_THAT(std::string(trajectory.status().message()), HasSubstr("t.tum"));
  }
}

}  // namespace
}  // namespace clearance::client
