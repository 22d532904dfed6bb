#include "server/core/bytes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "server/core/crc32c.h"

namespace clearance {
namespace {

TEST(Crc32c, EqualsThePublishedCheckValues) {
  EXPECT_EQ(Crc32c("123456789"), 0xe3069283u);
  EXPECT_EQ(Crc32c(std::string(32, 0)), 0x8a9136aau);
  EXPECT_EQ(Crc32c(std::string(32, '\xff')), 0x62a8ab43u);
  EXPECT_EQ(Crc32c(""), 0u);
}

TEST(Crc32c, ContinuesWhereItStopped) {
  std::string bytes(1003, 0);
  std::mt19937 random(5);
  for (char& c : bytes) c = static_cast<char>(random());
  for (size_t cut : {0, 1, 7, 8, 500, 1003}) {
    const std::string_view all = bytes;
    EXPECT_EQ(Crc32c(all.substr(cut), Crc32c(all.substr(0, cut))), Crc32c(all)) << cut;
  }
}

TEST(Bytes, ComeBackAsTheyWereWritten) {
  Pose pose = Pose::Identity();
  pose.rotate(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -3).normalized()));
  pose.translation() << -1e6, 1e-9, 3;
  ByteWriter out;
  out.Put<int32_t>(-7);
  out.PutText("name");
  out.PutVector<double>({1.5, -0.0, 1e300});
  out.PutPose(pose);
  out.PutText("");
  const std::string bytes = out.Take();
  ByteReader in(bytes, "test");
  EXPECT_EQ(in.Get<int32_t>(), -7);
  EXPECT_EQ(in.GetText(), "name");
  const std::vector<double> values = in.GetVector<double>();
  ASSERT_EQ(values.size(), 3u);
  EXPECT_TRUE(std::signbit(values[1]));
  EXPECT_EQ(in.GetPose().matrix(), pose.matrix());
  EXPECT_EQ(in.GetText(), "");
  EXPECT_TRUE(in.Finish().ok());
}

TEST(Bytes, EveryTruncationIsNoticedAndAllocatesNoMoreThanTheInput) {
  ByteWriter out;
  out.PutText("name");
  out.PutVector<uint64_t>({1, 2, 3});
  out.Put<uint16_t>(9);
  const std::string bytes = out.Take();
  for (size_t size = 0; size < bytes.size(); ++size) {
    ByteReader in(std::string_view(bytes).substr(0, size), "cut");
    in.GetText();
    EXPECT_LE(in.GetVector<uint64_t>().size(), 3u);
    in.Get<uint16_t>();
    EXPECT_TRUE(absl::IsDataLoss(in.Finish())) << size;
  }
  ByteWriter huge;
  huge.Put<uint64_t>(~0ull);
  const std::string count = huge.Take();
  ByteReader in(count, "huge");
  EXPECT_TRUE(in.GetVector<uint64_t>().empty());
  EXPECT_FALSE(in.ok());
  ByteReader more(bytes, "more");
  more.GetText();
  EXPECT_THAT(std::string(more.Finish().message()),
              ::testing::HasSubstr("more: 34 bytes too many"));
}

}  // namespace
}  // namespace clearance
