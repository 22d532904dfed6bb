#include "server/engine/map_store.h"

#include <gtest/gtest.h>

#include <future>

namespace clearance {
namespace {

using std::chrono::hours;
using std::chrono::steady_clock;

ViewPtr ViewOfRevision(uint64_t revision) {
  auto view = std::make_shared<MapView>();
  view->revision = view->field_revision = revision;
  return view;
}

struct Waiting {
  std::promise<absl::StatusOr<ViewPtr>> promise;
  std::future<absl::StatusOr<ViewPtr>> future = promise.get_future();
  ViewCallback Callback() {
    return [this](absl::StatusOr<ViewPtr> view) { promise.set_value(std::move(view)); };
  }
};

class MapStoreTest : public ::testing::Test {
 protected:
  TimerQueue timers_;
  std::shared_ptr<MapStore> store_ = std::make_shared<MapStore>(ViewOfRevision(0), &timers_, 3);
};

TEST_F(MapStoreTest, KeepsTheNewestRevisionsAndNamesThemWhenOneIsGone) {
  for (uint64_t r = 1; r <= 5; ++r) store_->Publish(ViewOfRevision(r));
  EXPECT_EQ(store_->Latest()->revision, 5u);
  for (uint64_t r = 3; r <= 5; ++r) EXPECT_EQ((*store_->Find(r))->revision, r);
  for (const uint64_t r : {2u, 6u}) {
    const auto found = store_->Find(r);
    EXPECT_TRUE(absl::IsOutOfRange(found.status()));
    EXPECT_NE(found.status().message().find("3 to 5"), std::string::npos);
  }
}

TEST_F(MapStoreTest, AnswersAtOnceWhereTheRevisionIsThere) {
  store_->Publish(ViewOfRevision(4));
  Waiting waiting;
  EXPECT_EQ(store_->WhenFieldRevision(4, steady_clock::now(), waiting.Callback()), 0u);
  EXPECT_EQ((*waiting.future.get())->revision, 4u);
}

TEST_F(MapStoreTest, WakesAWaiterWhenItsRevisionIsPublishedAndNotBefore) {
  Waiting waiting;
  store_->WhenFieldRevision(2, steady_clock::now() + hours(1), waiting.Callback());
  store_->Publish(ViewOfRevision(1));
  EXPECT_EQ(waiting.future.wait_for(std::chrono::seconds(0)), std::future_status::timeout);
  store_->Publish(ViewOfRevision(2));
  EXPECT_EQ((*waiting.future.get())->revision, 2u);
}

TEST_F(MapStoreTest, AbortsAtTheDeadlineAndNamesWhatWasReached) {
  store_->Publish(ViewOfRevision(7));
  Waiting waiting;
  store_->WhenFieldRevision(9, steady_clock::now() + std::chrono::milliseconds(1),
                            waiting.Callback());
  const absl::Status status = waiting.future.get().status();
  EXPECT_TRUE(absl::IsAborted(status));
  EXPECT_NE(status.message().find("9"), std::string::npos);
  EXPECT_NE(status.message().find("7"), std::string::npos);
}

TEST_F(MapStoreTest, ACancelledWaiterIsNeverCalled) {
  bool called = false;
  const uint64_t id = store_->WhenFieldRevision(1, steady_clock::now() + hours(1),
                                                [&](absl::StatusOr<ViewPtr>) { called = true; });
  store_->CancelWait(id);
  store_->Publish(ViewOfRevision(1));
  store_->Close(absl::UnavailableError("closed"));
  EXPECT_FALSE(called);
}

TEST_F(MapStoreTest, CloseEndsWaitsNowAndLater) {
  Waiting before, after;
  store_->WhenFieldRevision(1, steady_clock::now() + hours(1), before.Callback());
  store_->Close(absl::UnavailableError("closed"));
  EXPECT_TRUE(absl::IsUnavailable(before.future.get().status()));
  store_->WhenFieldRevision(1, steady_clock::now() + hours(1), after.Callback());
  EXPECT_TRUE(absl::IsUnavailable(after.future.get().status()));
}

TEST_F(MapStoreTest, MayGoWhileATimerRuns) {
  for (int i = 0; i < 200; ++i) {
    auto store = std::make_shared<MapStore>(ViewOfRevision(0), &timers_, 1);
    store->WhenFieldRevision(1, steady_clock::now(), [](absl::StatusOr<ViewPtr>) {});
    store.reset();
  }
}

}  // namespace
}  // namespace clearance
