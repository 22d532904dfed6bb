// Strong object ids: a label cannot be passed as an index.
#pragma once

#include <compare>
#include <cstdint>
#include <utility>

namespace clearance {

// The paper's j: 0 is the static world, 1..65535 are rigid objects named by the front end's labels.
class ObjectId {
 public:
  constexpr ObjectId() = default;
  constexpr explicit ObjectId(uint16_t value) : value_(value) {}

  constexpr uint16_t value() const { return value_; }
  constexpr bool is_static() const { return value_ == 0; }

  friend constexpr auto operator<=>(ObjectId, ObjectId) = default;
  template <typename H>
  friend H AbslHashValue(H h, ObjectId id) {
    return H::combine(std::move(h), id.value_);
  }

 private:
  uint16_t value_ = 0;
};

inline constexpr ObjectId kStaticWorld{};

}  // namespace clearance
