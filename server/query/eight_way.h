// Trees with eight children to a node, whose boxes one pass over eight lanes can test.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <utility>

#include "server/query/lanes.h"

namespace clearance {

inline constexpr int kWays = 8;

// Distance in an empty lane: farther than anything.
inline constexpr float kFarAway = 1e15f;

// Cuts `items` into at most eight runs of nearly equal length by three rounds of halving at the
// median of the widest axis. `key(item)` gives an array of coordinates; ties by `id(item)`, so that
// the outcome is the same everywhere. Returns the number of runs; run i is [bounds[i], bounds[i +
// 1]).
template <typename Item, typename Key, typename Id>
int CutInEight(std::span<Item> items, Key key, Id id, std::array<uint32_t, kWays + 1>* bounds) {
  using Coordinates = decltype(key(items[0]));
  std::array<std::pair<uint32_t, uint32_t>, kWays> runs{};
  runs[0] = {0u, static_cast<uint32_t>(items.size())};
  int count = 1;
  for (int round = 0; round < 3; ++round) {
    std::array<std::pair<uint32_t, uint32_t>, kWays> halves{};
    int written = 0;
    for (int r = 0; r < count; ++r) {
      const auto [first, last] = runs[r];
      if (last - first < 2) {
        halves[written++] = runs[r];
        continue;
      }
      Coordinates low = key(items[first]), high = low;
      for (uint32_t i = first + 1; i < last; ++i) {
        const Coordinates c = key(items[i]);
        for (size_t axis = 0; axis < c.size(); ++axis) {
          low[axis] = std::min(low[axis], c[axis]);
          high[axis] = std::max(high[axis], c[axis]);
        }
      }
      size_t widest = 0;
      for (size_t axis = 1; axis < low.size(); ++axis) {
        if (high[axis] - low[axis] > high[widest] - low[widest]) widest = axis;
      }
      const uint32_t middle = first + (last - first) / 2;
      std::nth_element(items.begin() + first, items.begin() + middle, items.begin() + last,
                       [&](const Item& a, const Item& b) {
                         return std::pair(key(a)[widest], id(a)) < std::pair(key(b)[widest], id(b));
                       });
      halves[written++] = {first, middle};
      halves[written++] = {middle, last};
    }
    runs = halves;
    count = written;
  }
  for (int r = 0; r < count; ++r) (*bounds)[r] = runs[r].first;
  (*bounds)[count] = static_cast<uint32_t>(items.size());
  return count;
}

// Children still to visit, nearest on top. Eight ways keep trees shallow: 2^32 items take eleven
// levels, each of which leaves at most seven behind.
class VisitStack {
 public:
  struct Visit {
    float bound;
    uint32_t child;
  };
  bool empty() const { return size_ == 0; }
  Visit Pop() { return visits_[--size_]; }

  // Adds the lanes whose bounds are at most `limit`, so that the nearest is popped first.
  void Push(const Floats& bounds, const uint32_t child[kWays], float limit) {
    const int base = size_;
    for (unsigned near = AtMost(bounds, limit); near != 0; near &= near - 1) {
      const int lane = std::countr_zero(near);
      int at = size_++;
      for (; at > base && visits_[at - 1].bound < bounds[lane]; --at) {
        visits_[at] = visits_[at - 1];
      }
      visits_[at] = {bounds[lane], child[lane]};
    }
  }

 private:
  std::array<Visit, 12 * kWays> visits_;
  int size_ = 0;
};

}  // namespace clearance
