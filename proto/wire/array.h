// Bulk arrays: little-endian bytes <-> numbers.
#pragma once

#include <bit>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

namespace clearance::wire {

static_assert(std::endian::native == std::endian::little,
              "the arrays are little-endian and are read and written without swapping");

// Number of elements of `width` values of `value_bytes` each. INVALID_ARGUMENT naming `field` where
// the length is not a multiple.
absl::StatusOr<size_t> ElementCount(std::string_view bytes, size_t value_bytes, size_t width,
                                    std::string_view field);

// INVALID_ARGUMENT naming the first element (of `width` values) that is not finite.
absl::Status CheckFinite(absl::Span<const float> values, size_t width, std::string_view field);
absl::Status CheckFinite(absl::Span<const double> values, size_t width, std::string_view field);

// All values of the array; floating point ones are finite.
template <typename T>
absl::StatusOr<std::vector<T>> DecodeArray(std::string_view bytes, size_t width,
                                           std::string_view field) {
  const absl::StatusOr<size_t> n = ElementCount(bytes, sizeof(T), width, field);
  if (!n.ok()) return n.status();
  std::vector<T> values(*n * width);
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  if constexpr (std::floating_point<T>) {
    if (absl::Status s = CheckFinite(values, width, field); !s.ok()) return s;
  }
  return values;
}

template <typename T>
std::string EncodeArray(absl::Span<const T> values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}
template <typename T>
std::string EncodeArray(const std::vector<T>& values) {
  return EncodeArray(absl::Span<const T>(values));
}

template <typename T>
std::string EncodeArray(std::initializer_list<T> values) {
  return EncodeArray(absl::Span<const T>(values.begin(), values.size()));
}

}  // namespace clearance::wire
