// Lets the threads that answer go before those that map.
#pragma once

#include <tbb/task_scheduler_observer.h>

namespace clearance {

// While it lives, the calling thread and the workers that help it have a lower scheduling priority
// than the rest of the process. Mapping keeps every core busy; a query comes now and then, is
// short, and a planner waits for it. Threads stay lowered: raising them again needs privileges.
// Where the system refuses, all stay as they are.
class BackgroundPriority : public tbb::task_scheduler_observer {
 public:
  BackgroundPriority();
  ~BackgroundPriority() override;

  void on_scheduler_entry(bool is_worker) override;
};

}  // namespace clearance
