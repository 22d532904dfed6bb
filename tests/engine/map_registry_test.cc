#include "server/engine/map_registry.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "tests/engine/ack_log.h"
#include "tests/engine/fake_model.h"

namespace clearance {
namespace {

using ::testing::HasSubstr;

class MapRegistryTest : public ::testing::Test {
 protected:
  MapRegistryTest() : registry_(FakeRegistry(log_, 2)) {}

  std::shared_ptr<FakeLog> log_ = std::make_shared<FakeLog>();
  MapRegistry registry_;
};

TEST_F(MapRegistryTest, EmptyMeansDefault) {
  EXPECT_TRUE(absl::IsNotFound(registry_.Get("").status()));
  ASSERT_TRUE(registry_.Create("default", {}).ok());
  EXPECT_EQ((*registry_.Get(""))->id(), "default");
}

TEST_F(MapRegistryTest, AMissingMapNamesThoseThatExist) {
  ASSERT_TRUE(registry_.Create("yard", {}).ok());
  ASSERT_TRUE(registry_.Create("demo", {}).ok());
  const absl::Status status = registry_.Get("hall").status();
  EXPECT_TRUE(absl::IsNotFound(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("'hall' does not exist. Maps: demo, yard"));
}

TEST_F(MapRegistryTest, RefusesBadIdsBadConfigsRepeatsAndTooMany) {
  for (const char* id : {"Yard", "1a", "a b", "a/b", "-a"}) {
    EXPECT_TRUE(absl::IsInvalidArgument(registry_.Create(id, {}).status())) << id;
  }
  EXPECT_TRUE(absl::IsInvalidArgument(registry_.Create(std::string(64, 'a'), {}).status()));
  MapConfig bad;
  bad.voxel_size_m = -1;
  EXPECT_TRUE(absl::IsInvalidArgument(registry_.Create("a", bad).status()));
  ASSERT_TRUE(registry_.Create("a", {}).ok());
  EXPECT_TRUE(absl::IsAlreadyExists(registry_.Create("a", {}).status()));
  ASSERT_TRUE(registry_.Create(std::string(63, 'a'), {}).ok());
  EXPECT_TRUE(absl::IsResourceExhausted(registry_.Create("c", {}).status()));
}

TEST_F(MapRegistryTest, ARecreatedMapIsEmptyAndInAnotherEpoch) {
  AckLog acks;
  const uint64_t epoch = (*registry_.Create("a", {}))->epoch();
  (*registry_.Get("a"))->Submit(FakeFrame(1), acks.Callback());
  acks.Wait(1);
  ASSERT_TRUE(registry_.Delete("a").ok());
  EXPECT_TRUE(absl::IsNotFound(registry_.Delete("a").status()));
  ASSERT_TRUE(registry_.Create("a", {}).ok());
  EXPECT_NE((*registry_.Get("a"))->epoch(), epoch);
  EXPECT_EQ((*registry_.Get("a"))->Latest()->revision, 0u);
}

TEST_F(MapRegistryTest, MapsAreIndependent) {
  AckLog a, b;
  (*registry_.Create("a", {}))->Submit(FakeFrame(3), a.Callback());
  (*registry_.Create("b", {}))->Submit(FakeFrame(1), b.Callback());
  EXPECT_EQ(a.Wait(1)[0].stamp.revision, 1u);
  EXPECT_EQ(b.Wait(1)[0].stamp.revision, 1u);
  EXPECT_EQ((*registry_.Get("b"))->LastSettledId("default"), 1u);
}

TEST_F(MapRegistryTest, ADeletedMapStaysReadableForThoseWhoHoldIt) {
  const auto engine = *registry_.Create("a", {});
  ASSERT_TRUE(registry_.Delete("a").ok());
  EXPECT_EQ(engine->Latest()->revision, 0u);
  EXPECT_EQ(engine->Submit(FakeFrame(1), [](const FrameAck&) {}), Admission::kStopped);
}

TEST_F(MapRegistryTest, RefusesNewMapsWhileDraining) {
  registry_.Drain(std::chrono::steady_clock::now());
  EXPECT_TRUE(absl::IsUnavailable(registry_.Create("a", {}).status()));
}

TEST_F(MapRegistryTest, ReadersWritersAndDeletionMayCollide) {
  ASSERT_TRUE(registry_.Create("a", {}).ok());
  std::atomic<bool> stop = false;
  std::vector<std::thread> threads;
  for (int t = 0; t < 2; ++t) {
    threads.emplace_back([&] {
      uint64_t last = 0, epoch = 0;
      while (!stop) {
        const auto engine = registry_.Get("a");
        if (!engine.ok()) continue;
        const ViewPtr view = (*engine)->Latest();
        if (view->epoch == epoch) {
          EXPECT_GE(view->revision, last);
        }
        epoch = view->epoch;
        last = view->revision;
        (*engine)->Stats();
      }
    });
  }
  threads.emplace_back([&] {
    for (uint64_t id = 1; !stop; ++id) {
      const auto engine = registry_.Get("a");
      if (engine.ok()) (*engine)->Submit(FakeFrame(id), [](const FrameAck&) {});
    }
  });
  for (int i = 0; i < 20; ++i) {
    ASSERT_TRUE(registry_.Delete("a").ok());
    ASSERT_TRUE(registry_.Create("a", {}).ok());
  }
  stop = true;
  for (std::thread& thread : threads) thread.join();
}

}  // namespace
}  // namespace clearance
