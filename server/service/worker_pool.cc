#include "server/service/worker_pool.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/wire/status_details.h"

namespace clearance {

WorkerPool::WorkerPool(int threads, size_t queue_capacity) : capacity_(queue_capacity) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { Run(); });
}

WorkerPool::~WorkerPool() { Stop(); }

absl::Status WorkerPool::Post(std::function<void()> work) {
  MutexLock lock(&mu_);
  if (stopping_) return absl::UnavailableError("the server is stopping");
  if (queue_.size() >= capacity_) {
    return wire::WithRetry(
        absl::ResourceExhaustedError(absl::StrFormat(
            "%d calls wait for a worker already, limit %d; try again", queue_.size(), capacity_)),
        absl::Milliseconds(100));
  }
  queue_.push_back(std::move(work));
  changed_.NotifyOne();
  return absl::OkStatus();
}

void WorkerPool::Stop() {
  {
    MutexLock lock(&mu_);
    stopping_ = true;
    changed_.NotifyAll();
  }
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

void WorkerPool::Run() {
  mu_.Lock();
  while (true) {
    if (queue_.empty()) {
      if (stopping_) break;
      changed_.Wait(&mu_);
      continue;
    }
    std::function<void()> work = std::move(queue_.front());
    queue_.pop_front();
    mu_.Unlock();
    work();
    work = nullptr;
    mu_.Lock();
  }
  mu_.Unlock();
}

}  // namespace clearance
