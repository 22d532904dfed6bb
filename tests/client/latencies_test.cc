#include "client/cli/latencies.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace clearance::cli {
namespace {

TEST(Latencies, PercentilesAreCallsThatWereMade) {
  Latencies latencies;
  EXPECT_EQ(latencies.Percentile(0.5), 0);
  EXPECT_TRUE(latencies.Bins().empty());
  for (int i = 1000; i >= 1; --i) latencies.Add(i);
  EXPECT_EQ(latencies.Percentile(0.5), 500);
  EXPECT_EQ(latencies.Percentile(0.99), 990);
  EXPECT_EQ(latencies.Percentile(0.999), 999);
  EXPECT_EQ(latencies.Percentile(1), 1000);
  EXPECT_EQ(latencies.Percentile(0), 1);
}

TEST(Latencies, BinsDoubleAndHoldEveryCall) {
  Latencies latencies, more;
  for (const double ms : {0.3, 0.5, 0.9, 1.0, 1.9}) latencies.Add(ms);
  for (const double ms : {2.0, 9.0, 0.0}) more.Add(ms);
  latencies.Merge(more);
  const std::vector<LatencyBin> bins = latencies.Bins();
  ASSERT_EQ(bins.size(), 14u);  // from 1/1024 ms, where 0 goes, to 16 ms
  EXPECT_EQ(bins.front().count, 1u);
  size_t count = 0;
  for (const LatencyBin& bin : bins) {
    EXPECT_DOUBLE_EQ(bin.to_ms, 2 * bin.from_ms);
    count += bin.count;
  }
  EXPECT_EQ(count, 8u);
  EXPECT_EQ(bins.back().from_ms, 8);
  EXPECT_EQ(bins.back().count, 1u);
  EXPECT_EQ(bins[10].count, 2u);  // [1, 2)
  EXPECT_EQ(latencies.ToJson()["count"], 8);
  EXPECT_THAT(latencies.Text(), ::testing::HasSubstr("p99.9 9.000"));
}

}  // namespace
}  // namespace clearance::cli
