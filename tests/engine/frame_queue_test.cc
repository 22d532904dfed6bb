#include "server/engine/frame_queue.h"

#include <gtest/gtest.h>

#include "tests/engine/fake_model.h"

namespace clearance {
namespace {

QueuedFrame Item(uint64_t id, int points) {
  QueuedFrame item;
  item.frame = FakeFrame(id, points);
  return item;
}

TEST(FrameQueue, BlocksAtItsCapacityOfFramesWithPoints) {
  FrameQueue queue({2, 4, OverloadPolicy::kBlock});
  queue.Push(Item(1, 1));
  EXPECT_TRUE(queue.HasRoom(true));
  queue.Push(Item(2, 1));
  EXPECT_FALSE(queue.HasRoom(true));
  EXPECT_TRUE(queue.HasRoom(false)) << "poses alone are small";
  EXPECT_EQ(queue.Pop()->frame.frame_id, 1u);
  EXPECT_TRUE(queue.HasRoom(true));
}

TEST(FrameQueue, DropsThePointsOfTheOldestFrameAndKeepsItsPlace) {
  FrameQueue queue({2, 4, OverloadPolicy::kDropOldestStatic});
  for (uint64_t id = 1; id <= 4; ++id) {
    ASSERT_TRUE(queue.HasRoom(true));
    queue.Push(Item(id, 1));
  }
  EXPECT_EQ(queue.size(), 4u);
  for (uint64_t id = 1; id <= 4; ++id) {
    const auto item = queue.Pop();
    ASSERT_TRUE(item);
    EXPECT_EQ(item->frame.frame_id, id);
    EXPECT_EQ(item->stripped, id <= 2);
    EXPECT_EQ(item->has_points(), id > 2);
  }
}

TEST(FrameQueue, IsBoundedUnderEitherPolicy) {
  for (const auto policy : {OverloadPolicy::kBlock, OverloadPolicy::kDropOldestStatic}) {
    FrameQueue queue({2, 3, policy});
    int pushed = 0;
    while (queue.HasRoom(false) && pushed < 100) queue.Push(Item(++pushed, 0));
    EXPECT_EQ(pushed, 5);
    EXPECT_FALSE(queue.HasRoom(true));
  }
}

}  // namespace
}  // namespace clearance
