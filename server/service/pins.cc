#include "server/service/pins.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/wire/status_details.h"

namespace clearance {

absl::StatusOr<PinTable::Pin> PinTable::Add(const std::string& map, ViewPtr view, double ttl_s) {
  if (ttl_s == 0) ttl_s = limits_.default_ttl_s;
  ttl_s = std::min(ttl_s, limits_.max_ttl_s);
  const Clock::time_point now = Clock::now();
  const Clock::time_point ends_at =
      now + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(ttl_s));
  MutexLock lock(&mu_);
  size_t count = 0;
  Clock::time_point first_end = Clock::time_point::max();
  for (const auto& [id, pin] : pins_) {
    if (pin.map != map) continue;
    ++count;
    first_end = std::min(first_end, pin.ends_at);
  }
  if (count >= limits_.max_pins) {
    const double wait_s = std::max(0.001, std::chrono::duration<double>(first_end - now).count());
    return wire::WithRetry(
        absl::ResourceExhaustedError(absl::StrFormat(
            "map '%s' has %d pins already, limit %d; release one, or wait %.3f s for one to end",
            map, count, limits_.max_pins, wait_s)),
        absl::Seconds(wait_s));
  }
  const uint64_t id = ++last_id_;
  const uint64_t timer = timers_->Schedule(ends_at, [weak = weak_from_this(), id] {
    if (const auto table = weak.lock()) table->Expire(id);
  });
  pins_.emplace(id, Held{map, std::move(view), ends_at, timer});
  return Pin{id, ttl_s};
}

void PinTable::Expire(uint64_t id) {
  Held ended;  // freed without the lock: a view may hold many megabytes
  MutexLock lock(&mu_);
  const auto it = pins_.find(id);
  if (it == pins_.end()) return;
  ended = std::move(it->second);
  pins_.erase(it);
}

absl::Status PinTable::NotFound(const std::string& map, uint64_t epoch, uint64_t id) const {
  std::string existing;
  for (const auto& [pin_id, pin] : pins_) {
    if (pin.map != map || pin.view->epoch != epoch) continue;
    absl::StrAppend(&existing, existing.empty() ? "" : ", ", pin_id);
    if (existing.size() > 200) {
      existing += ", ...";
      break;
    }
  }
  return absl::NotFoundError(absl::StrFormat(
      "pin %d of map '%s' does not exist: never made, released or expired. Pins: %s", id, map,
      existing.empty() ? "none" : existing));
}

absl::StatusOr<ViewPtr> PinTable::Find(const std::string& map, uint64_t epoch, uint64_t id) const {
  MutexLock lock(&mu_);
  const auto it = pins_.find(id);
  if (it == pins_.end() || it->second.map != map || it->second.view->epoch != epoch ||
      it->second.ends_at <= Clock::now()) {
    return NotFound(map, epoch, id);
  }
  return it->second.view;
}

absl::StatusOr<ViewPtr> PinTable::Release(const std::string& map, uint64_t epoch, uint64_t id) {
  Held released;
  MutexLock lock(&mu_);
  const auto it = pins_.find(id);
  if (it == pins_.end() || it->second.map != map || it->second.view->epoch != epoch) {
    return NotFound(map, epoch, id);
  }
  released = std::move(it->second);
  pins_.erase(it);
  timers_->Cancel(released.timer);
  return released.view;
}

size_t PinTable::Count(const std::string& map) const {
  MutexLock lock(&mu_);
  return static_cast<size_t>(std::count_if(
      pins_.begin(), pins_.end(), [&](const auto& entry) { return entry.second.map == map; }));
}

}  // namespace clearance
