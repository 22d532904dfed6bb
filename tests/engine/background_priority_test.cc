#include "server/engine/background_priority.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <mutex>
#include <set>
#include <thread>

namespace clearance {
namespace {

int PriorityOfThisThread() { return getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())); }

TEST(BackgroundPriority, LowersTheThreadAndItsWorkersAndNobodyElse) {
  const int before = PriorityOfThisThread();
  const int lowered = std::min(before + 5, 19);
  std::mutex mu;
  std::set<int> seen;
  std::thread mapping([&] {
    const BackgroundPriority background;
    tbb::parallel_for(0, 2000, [&](int) {
      const int priority = PriorityOfThisThread();
      const std::lock_guard lock(mu);
      seen.insert(priority);
    });
  });
  mapping.join();
  EXPECT_EQ(seen, std::set<int>{lowered});
  EXPECT_EQ(PriorityOfThisThread(), before);
  std::thread other([&] { EXPECT_EQ(PriorityOfThisThread(), before); });
  other.join();
}

}  // namespace
}  // namespace clearance
