#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/cli/context.h"
#include "client/cli/ingest_counts.h"
#include "client/cli/print.h"
#include "client/cli/progress.h"

namespace clearance::cli {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(CliOutput, TablesAlignNumbersRightAndTextLeft) {
  Table table({"id", "class", "speed"});
  table.Add({"1", "Van", "12.50"});
  table.Add({"13", "Cyclist", "3.10"});
  EXPECT_EQ(table.Text(),
            "id  class    speed\n"
            " 1  Van      12.50\n"
            "13  Cyclist   3.10\n");
}

TEST(CliOutput, NamesStatesAndFlags) {
  EXPECT_EQ(StateName(0x80), "unknown");
  EXPECT_EQ(StateName(0x01), "free");
  EXPECT_EQ(StateName(0x42), "occupied");
  EXPECT_THAT(FlagNames(0x4c), ElementsAre("predicted", "clamped", "stale"));
  EXPECT_TRUE(FlagNames(0x02).empty());
}

TEST(CliOutput, ExitCodesAreStable) {
  EXPECT_EQ(ExitCodeOf(absl::OkStatus()), 0);
  EXPECT_EQ(ExitCodeOf(absl::NotFoundError("")), 3);
  EXPECT_EQ(ExitCodeOf(absl::InvalidArgumentError("")), 4);
  EXPECT_EQ(ExitCodeOf(absl::DataLossError("")), 4);
  EXPECT_EQ(ExitCodeOf(absl::OutOfRangeError("")), 4);
  EXPECT_EQ(ExitCodeOf(absl::UnavailableError("")), 5);
  EXPECT_EQ(ExitCodeOf(absl::DeadlineExceededError("")), 6);
  EXPECT_EQ(ExitCodeOf(absl::InternalError("")), 1);
}

TEST(CliOutput, ProgressSaysHowFarHowFastAndHowLong) {
  EXPECT_EQ(ProgressLine(30, 60, 15, 5),
            "[###############...............] 30/60  15.0 frames/s  ETA 2 s  5 objects");
  EXPECT_THAT(ProgressLine(0, 60, 0, -1), HasSubstr("0/60"));
  EXPECT_THAT(ProgressLine(0, 60, 0, -1), ::testing::Not(HasSubstr("ETA")));
}

TEST(CliOutput, CountsEveryKindOfAckOnce) {
  IngestCounts counts;
  const auto ack = [&](uint64_t id, client::AckStatus status) {
    client::FrameAck a;
    a.frame_id = id;
    a.status = status;
    a.integrate_ms = static_cast<double>(id);
    if (status == client::AckStatus::kRejected) a.violations.push_back({"frame.x", 3, "got y"});
    counts.Add(a);
  };
  ack(1, client::AckStatus::kAccepted);
  ack(1, client::AckStatus::kIntegrated);
  ack(2, client::AckStatus::kIntegrated);
  ack(3, client::AckStatus::kRejected);
  ack(4, client::AckStatus::kDropped);
  ack(5, client::AckStatus::kDuplicate);
  const IngestSummary summary = counts.Get();
  EXPECT_EQ(summary.integrated, 2u);
  EXPECT_EQ(summary.settled(), 5u);
  EXPECT_THAT(summary.first_violations, ElementsAre("frame 3: frame.x[3]: got y"));
  EXPECT_THAT(summary.integrate_ms, ElementsAre(1, 2));
}

TEST(CliOutput, PercentilesAreValuesOfTheData) {
  EXPECT_EQ(Percentile({}, 0.5), 0);
  EXPECT_EQ(Percentile({3, 1, 2}, 0.5), 2);
  EXPECT_EQ(Percentile({3, 1, 2}, 0.95), 3);
}

}  // namespace
}  // namespace clearance::cli
