#include "client/sequence/ply_cloud.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "tests/client/test_files.h"

namespace clearance::client {
namespace {

using ::testing::HasSubstr;

TEST(PlyCloud, ReadsPointsAndLabels) {
  const auto cloud = ParsePlyCloud(PlyCloud({1, 2, 3, -4, -5.5f, -6}, {0, 65535}), "a.ply");
  ASSERT_TRUE(cloud.ok()) << cloud.status();
  EXPECT_TRUE(cloud->points_X.col(1) == Eigen::Vector3f(-4, -5.5f, -6));
  EXPECT_EQ(cloud->labels, (std::vector<uint16_t>{0, 65535}));
}

TEST(PlyCloud, ReadsOtherTypesAndOrdersOfProperties) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar red\n"
      "property double z\nproperty double y\nproperty double x\nproperty int label\nend_header\n";
  bytes += '\x09';
  for (const double v : {3.0, 2.0, 1.0}) bytes.append(reinterpret_cast<const char*>(&v), 8);
  const int32_t label = 12;
  bytes.append(reinterpret_cast<const char*>(&label), 4);
  const auto cloud = ParsePlyCloud(bytes, "a.ply");
  ASSERT_TRUE(cloud.ok()) << cloud.status();
  EXPECT_TRUE(cloud->points_X.col(0) == Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(cloud->labels[0], 12);
}

TEST(PlyCloud, AnEmptyCloudIsValid) {
  const auto cloud = ParsePlyCloud(PlyCloud({}, {}), "a.ply");
  ASSERT_TRUE(cloud.ok()) << cloud.status();
  EXPECT_EQ(cloud->points_X.cols(), 0);
}

TEST(PlyCloud, EveryTruncationIsAnErrorThatNamesTheFile) {
  const std::string whole = PlyCloud({1, 2, 3, 4, 5, 6}, {0, 1});
  for (size_t size = 0; size < whole.size(); ++size) {
    const auto cloud = ParsePlyCloud(whole.substr(0, size), "cloud/000003.ply");
    ASSERT_EQ(cloud.status().code(), absl::StatusCode::kDataLoss) << size;
    EXPECT_THAT(std::string(cloud.status().message()), HasSubstr("cloud/000003.ply"));
  }
}

TEST(PlyCloud, BadHeadersNameTheLine) {
  const std::string good = PlyCloud({1, 2, 3}, {0});
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string bytes = good;
    bytes.replace(bytes.find(from), from.size(), to);
    return std::string(ParsePlyCloud(bytes, "a.ply").status().message());
  };
  EXPECT_THAT(broken("ply\n", "plx\n"), HasSubstr("a.ply:1: got another file"));
  EXPECT_THAT(broken("binary_little_endian", "ascii"), HasSubstr("a.ply:2: got another format"));
  EXPECT_THAT(broken("vertex 1", "vertex -1"), HasSubstr("a.ply:4: got -1"));
  EXPECT_THAT(broken("vertex 1", "vertex 9223372036854775807"), HasSubstr("ends at byte"));
  EXPECT_THAT(broken("float y", "float w"), HasSubstr("no vertex property y"));
  EXPECT_THAT(broken("float z", "list z"), HasSubstr("scalar type"));
}

TEST(PlyCloud, ValuesThatCannotBeAreNamedByVertex) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(
      std::string(
          ParsePlyCloud(PlyCloud({1, 2, 3, 1, nan, 3}, {0, 0}), "a.ply").status().message()),
      HasSubstr("vertex 1: got (1, nan, 3)"));
}

TEST(PlyCloud, FlippedBytesNeverCrash) {
  const std::string whole = PlyCloud({1, 2, 3, 4, 5, 6}, {0, 1});
  std::mt19937 rng(3);
  for (int i = 0; i < 5000; ++i) {
    std::string bytes = whole;
    for (int k = 0; k < 3; ++k) bytes[rng() % bytes.size()] = static_cast<char>(rng());
    const auto cloud = ParsePlyCloud(bytes, "a.ply");
    if (cloud.ok()) {
      EXPECT_TRUE(cloud->points_X.allFinite());
    }
  }
}

}  // namespace
}  // namespace clearance::client
