#include "server/engine/latency.h"

#include <gtest/gtest.h>

namespace clearance {
namespace {

TEST(LatencyHistogram, KnowsQuantilesToAFewPerCent) {
  LatencyHistogram histogram;
  for (int i = 1; i <= 1000; ++i) histogram.Add(i * 0.1);
  const LatencySummary summary = histogram.Summary();
  EXPECT_EQ(summary.count, 1000u);
  EXPECT_NEAR(summary.mean_ms, 50.05, 1e-9);
  EXPECT_NEAR(summary.p50_ms, 50, 5);
  EXPECT_NEAR(summary.p95_ms, 95, 9.5);
  EXPECT_NEAR(summary.p99_ms, 99, 9.9);
  EXPECT_DOUBLE_EQ(summary.max_ms, 100);
}

TEST(LatencyHistogram, IsEmptyWithoutSamplesAndTakesAnything) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.Summary().count, 0u);
  for (const double ms : {0.0, -1.0, 1e-9, 1e12}) histogram.Add(ms);
  EXPECT_EQ(histogram.Summary().count, 4u);
  EXPECT_EQ(histogram.CountUpTo(1e13), 4u);
  EXPECT_EQ(histogram.CountUpTo(0.001), 3u);
}

}  // namespace
}  // namespace clearance
