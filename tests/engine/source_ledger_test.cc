#include "server/engine/source_ledger.h"

#include <gtest/gtest.h>

namespace clearance {
namespace {

using Kind = SourceLedger::Judgement::Kind;

FrameAck Settled(uint64_t id, uint64_t revision,
                 FrameAck::Status status = FrameAck::Status::kIntegrated) {
  FrameAck ack;
  ack.frame_id = id;
  ack.status = status;
  ack.stamp.revision = revision;
  return ack;
}

TEST(SourceLedger, TakesIdsAndStampsThatRise) {
  SourceLedger ledger;
  EXPECT_EQ(ledger.Judge(5, 100).kind, Kind::kNew);
  ledger.Admit(5, 100);
  EXPECT_EQ(ledger.Judge(7, 101).kind, Kind::kNew) << "gaps are allowed";
  EXPECT_TRUE(ledger.Judge(7, 101).violation.field.empty());
}

TEST(SourceLedger, RemembersTheFirstRevisionOfSettledFrames) {
  SourceLedger ledger;
  ledger.Admit(5, 100);
  EXPECT_EQ(ledger.Judge(5, 100).kind, Kind::kPending);
  ledger.Settle(Settled(5, 3));
  const auto judged = ledger.Judge(5, 100);
  EXPECT_EQ(judged.kind, Kind::kSettled);
  EXPECT_EQ(judged.stamp.revision, 3u);
  EXPECT_EQ(ledger.last_settled_id(), 5u);
}

TEST(SourceLedger, RefusesAnIdThatGoesBackAndNamesBothIds) {
  SourceLedger ledger;
  ledger.Admit(9, 100);
  ledger.Settle(Settled(9, 1));
  const auto judged = ledger.Judge(4, 200);
  EXPECT_EQ(judged.kind, Kind::kRefused);
  EXPECT_EQ(judged.violation.field, "frame.frame_id");
  EXPECT_NE(judged.violation.description.find("got 4"), std::string::npos);
  EXPECT_NE(judged.violation.description.find("9"), std::string::npos);
}

TEST(SourceLedger, ANewIdWithAStampThatGoesBackSettlesAsRejected) {
  SourceLedger ledger;
  ledger.Admit(1, 100);
  for (const int64_t stamp : {100, 99, -5}) {
    const auto judged = ledger.Judge(2, stamp);
    EXPECT_EQ(judged.kind, Kind::kNew);
    EXPECT_EQ(judged.violation.field, "frame.stamp_ns") << stamp;
  }
  ledger.Settle(Settled(1, 1));
  ledger.Admit(2, std::nullopt);
  ledger.Settle(Settled(2, 1, FrameAck::Status::kRejected));
  EXPECT_EQ(ledger.last_settled_id(), 2u) << "a rejected frame is settled";
  EXPECT_EQ(ledger.rejected(), 1u);
  EXPECT_TRUE(ledger.Judge(3, 101).violation.field.empty()) << "its stamp does not count";
}

TEST(SourceLedger, ForgetsIdsBeyondItsWindow) {
  SourceLedger ledger(2);
  for (uint64_t id = 1; id <= 3; ++id) {
    ledger.Admit(id, static_cast<int64_t>(id));
    ledger.Settle(Settled(id, id));
  }
  EXPECT_EQ(ledger.Judge(1, 10).kind, Kind::kRefused);
  EXPECT_EQ(ledger.Judge(2, 10).kind, Kind::kSettled);
  EXPECT_EQ(ledger.Judge(3, 10).kind, Kind::kSettled);
}

TEST(SourceLedger, TellsRepeatsOfAPendingFrameWhenItSettles) {
  SourceLedger ledger;
  ledger.Admit(1, 1);
  int told = 0;
  ledger.AddRepeat(1, [&](const FrameAck&) { ++told; });
  ledger.AddRepeat(1, [&](const FrameAck&) { ++told; });
  for (const auto& repeat : ledger.Settle(Settled(1, 1))) repeat({});
  EXPECT_EQ(told, 2);
}

}  // namespace
}  // namespace clearance
