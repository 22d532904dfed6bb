#include "server/engine/mapping_engine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>

#include "tests/engine/ack_log.h"
#include "tests/engine/fake_model.h"
#include "tests/engine/gate.h"

namespace clearance {
namespace {

using Status = FrameAck::Status;
using std::chrono::steady_clock;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class MappingEngineTest : public ::testing::Test {
 protected:
  std::unique_ptr<MappingEngine> Make(EngineOptions options = {}, MapConfig config = {}) {
    return std::make_unique<MappingEngine>("yard", config,
                                           std::make_unique<FakeModel>(config, log_), 77, &timers_,
                                           std::move(options));
  }
  EngineOptions Held(size_t queue_frames = 8) {
    EngineOptions options;
    options.queue_frames = queue_frames;
    options.before_integrate = [this](const Frame&) { gate_.Pass(); };
    return options;
  }

  TimerQueue timers_;
  std::shared_ptr<FakeLog> log_ = std::make_shared<FakeLog>();
  Gate gate_;
  AckLog acks_;
};

TEST_F(MappingEngineTest, IntegratesInOrderAndAcksWhatIsAlreadyPublished) {
  auto engine = Make();
  for (uint64_t id = 1; id <= 5; ++id) {
    ASSERT_EQ(engine->Submit(FakeFrame(id),
                             [&](const FrameAck& ack) {
                               EXPECT_GE(engine->Latest()->revision, ack.stamp.revision)
                                   << "published before the ack";
                               acks_.Callback()(ack);
                             }),
              Admission::kTaken);
  }
  const auto acks = acks_.Wait(5);
  ASSERT_EQ(acks.size(), 5u);
  for (size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(acks[i].status, Status::kIntegrated);
    EXPECT_EQ(acks[i].frame_id, i + 1);
    EXPECT_EQ(acks[i].stamp.revision, i + 1);
    EXPECT_EQ(acks[i].stamp.epoch, 77u);
    EXPECT_EQ(acks[i].stamp.stamp_ns, static_cast<int64_t>(i + 1) * 100'000'000);
  }
  EXPECT_EQ(engine->LastSettledId("default"), 5u);
  EXPECT_EQ(engine->LastSettledId("other"), std::nullopt);
}

TEST_F(MappingEngineTest, AnswersFromThePreviousRevisionWhileAFrameIsIntegrated) {
  auto engine = Make(Held());
  engine->Submit(FakeFrame(1), acks_.Callback());
  gate_.WaitForArrival();
  EXPECT_EQ(engine->Latest()->revision, 0u);
  EXPECT_EQ(engine->Stats().sources.size(), 1u);
  EXPECT_EQ(engine->LastSettledId("default"), std::nullopt);
  gate_.Open();
  EXPECT_EQ(acks_.Wait(1)[0].stamp.revision, 1u);
}

TEST_F(MappingEngineTest, ARepeatedFrameIsADuplicateAtItsFirstRevision) {
  auto engine = Make();
  engine->Submit(FakeFrame(1), acks_.Callback());
  engine->Submit(FakeFrame(2), acks_.Callback());
  acks_.Wait(2);
  engine->Submit(FakeFrame(1), acks_.Callback());
  const FrameAck repeat = acks_.Wait(3)[2];
  EXPECT_EQ(repeat.status, Status::kDuplicate);
  EXPECT_EQ(repeat.stamp.revision, 1u);
  EXPECT_EQ(engine->Latest()->revision, 2u);
  EXPECT_THAT(log_->integrated, ElementsAre(1, 2));
}

TEST_F(MappingEngineTest, ARepeatOfAWaitingFrameSettlesWithIt) {
  auto engine = Make(Held());
  engine->Submit(FakeFrame(1), acks_.Callback());
  gate_.WaitForArrival();
  engine->Submit(FakeFrame(2), acks_.Callback());
  engine->Submit(FakeFrame(2), acks_.Callback());
  gate_.Open();
  const auto acks = acks_.Wait(3);
  EXPECT_EQ(acks[1].status, Status::kIntegrated);
  EXPECT_EQ(acks[2].status, Status::kDuplicate);
  EXPECT_EQ(acks[2].stamp.revision, 2u);
  EXPECT_THAT(log_->integrated, ElementsAre(1, 2));
}

TEST_F(MappingEngineTest, RejectsIdsAndStampsThatGoBackAndTheRevisionStays) {
  auto engine = Make();
  engine->Submit(FakeFrame(5), acks_.Callback());
  acks_.Wait(1);
  engine->Submit(FakeFrame(4), acks_.Callback());
  Frame old_stamp = FakeFrame(6);
  old_stamp.stamp_ns = 1;
  engine->Submit(std::move(old_stamp), acks_.Callback());
  const auto acks = acks_.Wait(3);
  EXPECT_EQ(acks[1].status, Status::kRejected);
  EXPECT_EQ(acks[1].violations.at(0).field, "frame.frame_id");
  EXPECT_EQ(acks[2].status, Status::kRejected);
  EXPECT_EQ(acks[2].violations.at(0).field, "frame.stamp_ns");
  EXPECT_EQ(engine->Latest()->revision, 1u);
  EXPECT_EQ(engine->LastSettledId("default"), 6u);
}

TEST_F(MappingEngineTest, AFrameThatCannotBeIntegratedIsRejectedAndTheNextOneCounts) {
  auto engine = Make();
  Frame bad = FakeFrame(1);
  std::get<PointCloud>(bad.observation).points_X(1, 0) = NAN;
  engine->Submit(std::move(bad), acks_.Callback());
  engine->Submit(FakeFrame(2), acks_.Callback());
  const auto acks = acks_.Wait(2);
  EXPECT_EQ(acks[0].status, Status::kRejected);
  EXPECT_EQ(acks[0].stamp.revision, 0u);
  EXPECT_EQ(acks[1].status, Status::kIntegrated);
  EXPECT_EQ(acks[1].stamp.revision, 1u);
}

TEST_F(MappingEngineTest, RejectedFramesSettleInTheirTurn) {
  auto engine = Make(Held());
  engine->Submit(FakeFrame(1), acks_.Callback());
  gate_.WaitForArrival();
  engine->SubmitRejected("default", 2, {{"frame.cloud", -1, "bad"}}, acks_.Callback());
  EXPECT_EQ(engine->LastSettledId("default"), std::nullopt)
      << "a client that resumed behind 2 now would lose frame 1";
  gate_.Open();
  const auto acks = acks_.Wait(2);
  EXPECT_EQ(acks[0].frame_id, 1u);
  EXPECT_EQ(acks[1].status, Status::kRejected);
  EXPECT_EQ(acks[1].violations.at(0).field, "frame.cloud");
  EXPECT_EQ(engine->LastSettledId("default"), 2u);
}

TEST_F(MappingEngineTest, SourcesHaveIdsOfTheirOwn) {
  auto engine = Make();
  engine->Submit(FakeFrame(9, 1, "left"), acks_.Callback());
  engine->Submit(FakeFrame(2, 1, "right"), acks_.Callback());
  for (const FrameAck& ack : acks_.Wait(2)) EXPECT_EQ(ack.status, Status::kIntegrated);
  EXPECT_EQ(engine->LastSettledId("left"), 9u);
  EXPECT_EQ(engine->LastSettledId("right"), 2u);
}

TEST_F(MappingEngineTest, AFullQueueRefusesAndTellsWhenThereIsRoom) {
  auto engine = Make(Held(1));
  engine->Submit(FakeFrame(1), acks_.Callback());
  gate_.WaitForArrival();
  ASSERT_EQ(engine->Submit(FakeFrame(2), acks_.Callback()), Admission::kTaken);
  Frame third = FakeFrame(3);
  ASSERT_EQ(engine->Submit(std::move(third), acks_.Callback()), Admission::kFull);
  EXPECT_EQ(third.frame_id, 3u);
  EXPECT_TRUE(std::holds_alternative<PointCloud>(third.observation)) << "untouched";
  std::promise<void> room;
  engine->NotifyRoom([&] { room.set_value(); });
  gate_.Open();
  room.get_future().wait();
  EXPECT_EQ(engine->Submit(std::move(third), acks_.Callback()), Admission::kTaken);
  EXPECT_EQ(acks_.Wait(3).size(), 3u);
}

TEST_F(MappingEngineTest, OverloadDropsPointsButNeverPoses) {
  MapConfig config;
  config.overload = OverloadPolicy::kDropOldestStatic;
  auto engine = Make(Held(2), config);
  engine->Submit(FakeFrame(1), acks_.Callback());
  gate_.WaitForArrival();
  for (uint64_t id = 2; id <= 5; ++id) {
    EXPECT_EQ(engine->Submit(FakeFrame(id), acks_.Callback()), Admission::kTaken);
  }
  gate_.Open();
  const auto acks = acks_.Wait(5);
  const Status expected[] = {Status::kIntegrated, Status::kDropped, Status::kDropped,
                             Status::kIntegrated, Status::kIntegrated};
  for (int i = 0; i < 5; ++i) EXPECT_EQ(acks[i].status, expected[i]) << i;
  EXPECT_THAT(log_->integrated, ElementsAre(1, 2, 3, 4, 5));
  EXPECT_THAT(log_->integrated_points, ElementsAre(1, 0, 0, 1, 1));
  EXPECT_EQ(engine->Stats().sources[0].dropped, 2u);
}

TEST_F(MappingEngineTest, EditsRunBetweenFramesAndMakeARevisionThatIsNotFresher) {
  auto engine = Make();
  engine->Submit(FakeFrame(1), acks_.Callback());
  acks_.Wait(1);
  const auto published_at = engine->Latest()->published_at;
  std::promise<std::pair<uint64_t, RevisionStamp>> done;
  ASSERT_TRUE(
      engine
          ->EditRegion({},
                       [&](absl::StatusOr<MapModel::Edited> edited, const RevisionStamp& stamp) {
                         done.set_value({edited->changed_voxels, stamp});
                       })
          .ok());
  const auto [voxels, stamp] = done.get_future().get();
  EXPECT_EQ(voxels, 7u);
  EXPECT_EQ(stamp.revision, 2u);
  EXPECT_EQ(engine->Latest()->revision, 2u);
  EXPECT_EQ(engine->Latest()->published_at, published_at);
}

TEST_F(MappingEngineTest, RefusesMoreTasksThanItHolds) {
  EngineOptions options = Held();
  options.queue_tasks = 1;
  auto engine = Make(std::move(options));
  engine->Submit(FakeFrame(1), acks_.Callback());
  gate_.WaitForArrival();
  EXPECT_TRUE(engine->Post([](MapModel*, const ViewPtr&) {}).ok());
  EXPECT_TRUE(absl::IsResourceExhausted(engine->Post([](MapModel*, const ViewPtr&) {})));
  gate_.Open();
}

TEST_F(MappingEngineTest, DrainSettlesWhatWaitsAndRefusesTheRest) {
  auto engine = Make(Held());
  for (uint64_t id = 1; id <= 4; ++id) engine->Submit(FakeFrame(id), acks_.Callback());
  gate_.WaitForArrival();
  EXPECT_FALSE(engine->Drain(steady_clock::now())) << "a frame is held";
  EXPECT_EQ(engine->Submit(FakeFrame(5), acks_.Callback()), Admission::kStopped);
  gate_.Open();
  EXPECT_TRUE(engine->Drain(steady_clock::now() + std::chrono::minutes(1)));
  EXPECT_EQ(acks_.Wait(4).size(), 4u);
  EXPECT_EQ(engine->LastSettledId("default"), 4u);
}

TEST_F(MappingEngineTest, StopAbandonsWhatWaitsSoThatItCanComeAgain) {
  auto engine = Make(Held());
  for (uint64_t id = 1; id <= 3; ++id) engine->Submit(FakeFrame(id), acks_.Callback());
  std::promise<bool> task_had_model;
  gate_.WaitForArrival();
  ASSERT_TRUE(engine
                  ->Post([&](MapModel* model, const ViewPtr&) {
                    task_had_model.set_value(model != nullptr);
                  })
                  .ok());
  std::thread stopper([&] { engine->Stop(); });
  // Stop waits for the frame at hand; only then is the gate opened.
  while (engine->Submit(FakeFrame(9), [](const FrameAck&) {}) != Admission::kStopped) {
    std::this_thread::yield();
  }
  gate_.Open();
  stopper.join();
  int integrated = 0, abandoned = 0;
  for (const FrameAck& ack : acks_.Wait(3)) {
    integrated += ack.status == Status::kIntegrated;
    abandoned += ack.status == Status::kAbandoned;
  }
  EXPECT_EQ(integrated, 1);
  EXPECT_EQ(abandoned, 2);
  EXPECT_EQ(engine->LastSettledId("default"), 1u);
  EXPECT_FALSE(task_had_model.get_future().get());
  EXPECT_TRUE(absl::IsUnavailable(engine->Post([](MapModel*, const ViewPtr&) {})));
}

}  // namespace
}  // namespace clearance
