#include "server/engine/change_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "server/map/field_differences.h"

namespace clearance {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// A map that a test changes by hand.
struct Script {
  MapView now;
  Script() { now.epoch = 5; }
  void Set(const BlockIndex& block) { now.field.Set(block, std::make_shared<FieldBlock>()); }
  std::shared_ptr<const MapView> Publish() {
    ++now.revision;
    return std::make_shared<MapView>(now);
  }
  ObjectView& Add(uint16_t id, uint32_t generation = 1) {
    ObjectView& object = now.objects.emplace_back();
    object.id = ObjectId(id);
    object.generation = generation;
    object.shape = std::make_shared<ObjectShape>();
    return object;
  }
};

TEST(ChangeLog, NamesEachBlockOnceThatChangedBehindARevision) {
  Script script;
  ChangeLog log(script.Publish());  // 1
  script.Set({1, 0, 0});
  script.Set({2, 0, 0});
  log.Advance(script.Publish());  // 2
  script.Set({1, 0, 0});
  script.now.field.Set({2, 0, 0}, nullptr);
  script.Set({-3, 0, 0});
  log.Advance(script.Publish());  // 3
  log.Advance(script.Publish());  // 4
  EXPECT_THAT(log.Since(1)->blocks,
              ElementsAre(BlockIndex{-3, 0, 0}, BlockIndex{1, 0, 0}, BlockIndex{2, 0, 0}));
  EXPECT_THAT(log.Since(2)->blocks,
              ElementsAre(BlockIndex{-3, 0, 0}, BlockIndex{1, 0, 0}, BlockIndex{2, 0, 0}));
  EXPECT_THAT(log.Since(3)->blocks, IsEmpty());
  EXPECT_THAT(log.Since(4)->blocks, IsEmpty());
  EXPECT_FALSE(log.Since(0).has_value());
  EXPECT_FALSE(log.Since(5).has_value());
  EXPECT_EQ(log.previous()->revision, 3u);
}

TEST(ChangeLog, NamesSurfacesThatChangedAndObjectsThatAreGone) {
  Script script;
  script.Add(1);
  ChangeLog log(script.Publish());  // 1
  script.Add(2);
  log.Advance(script.Publish());  // 2
  script.now.objects[0].shape = std::make_shared<ObjectShape>();
  log.Advance(script.Publish());  // 3
  script.now.objects[0].T_W_L.translation().x() += 1;
  log.Advance(script.Publish());  // 4: moved, that is all
  script.now.objects.erase(script.now.objects.begin());
  log.Advance(script.Publish());  // 5
  const ObjectKey first(ObjectId(1), 1), second(ObjectId(2), 1);
  EXPECT_THAT(log.Since(1)->surfaces, ElementsAre(second));
  EXPECT_THAT(log.Since(2)->surfaces, IsEmpty()) << "of one that is gone";
  EXPECT_THAT(log.Since(2)->evicted, ElementsAre(first));
  EXPECT_THAT(log.Since(4)->evicted, ElementsAre(first));
  EXPECT_THAT(log.Since(5)->evicted, IsEmpty());
}

TEST(ChangeLog, IgnoresOtherEpochsAndOlderViews) {
  Script script;
  const auto first = script.Publish();
  ChangeLog log(first);
  const auto second = script.Publish();
  log.Advance(second);
  log.Advance(first);
  Script other;
  other.now.epoch = 6;
  other.now.revision = 10;
  log.Advance(other.Publish());
  EXPECT_EQ(log.newest(), second);
}

// Any reader, however late, is named at least what differs, and nothing that never changed; the
// log stays as small as the map.
TEST(ChangeLog, CoversTheDifferenceBetweenAnyTwoViewsInBoundedMemory) {
  std::mt19937 random(1);
  Script script;
  std::vector<std::shared_ptr<const MapView>> views = {script.Publish()};
  ChangeLog log(views[0]);
  std::set<BlockIndex> touched;
  for (int step = 0; step < 3000; ++step) {
    for (int i = 0; i < 60; ++i) {
      const BlockIndex block{static_cast<int>(random() % 16) - 8, static_cast<int>(random() % 16),
                             0};
      touched.insert(block);
      if (random() % 4 == 0) {
        script.now.field.Set(block, nullptr);
      } else {
        script.Set(block);
      }
    }
    const auto view = script.Publish();
    if (random() % 3 == 0) continue;  // one that the log was not shown
    log.Advance(view);
    if (step % 50 == 0) views.push_back(view);
  }
  for (const auto& view : views) {
    const auto changes = log.Since(view->revision);
    ASSERT_TRUE(changes.has_value());
    const std::set<BlockIndex> named(changes->blocks.begin(), changes->blocks.end());
    EXPECT_EQ(named.size(), changes->blocks.size());
    for (const auto& d : DifferencesBetween(view->field, log.newest()->field)) {
      EXPECT_TRUE(named.contains(d.index));
    }
    for (const BlockIndex& block : named) EXPECT_TRUE(touched.contains(block));
  }
  EXPECT_LT(log.size(), 70'000u) << "of 120,000 changes";
}

}  // namespace
}  // namespace clearance
