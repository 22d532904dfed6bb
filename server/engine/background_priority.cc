#include "server/engine/background_priority.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace clearance {
namespace {

// A thread in the foreground gets three quarters of a core that it shares with one of ours, and is
// run as soon as it wakes.
constexpr int kSteps = 5;
constexpr int kLowest = 19;

void LowerThisThread() {
  thread_local bool lowered = false;
  if (lowered) return;
  lowered = true;
  // Linux: a priority is a thread's own, and inherited. Counted from the main thread's, so that a
  // worker started by a lowered thread is not lowered twice.
  errno = 0;
  const int normal = getpriority(PRIO_PROCESS, static_cast<id_t>(getpid()));
  if (errno != 0) return;
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), std::min(normal + kSteps, kLowest));
}

}  // namespace

BackgroundPriority::BackgroundPriority() {
  LowerThisThread();
  observe(true);
}

BackgroundPriority::~BackgroundPriority() { observe(false); }

void BackgroundPriority::on_scheduler_entry(bool is_worker) {
  if (is_worker) LowerThisThread();
}

}  // namespace clearance
