#include "proto/wire/array.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

template <typename T>
absl::Status CheckAllFinite(absl::Span<const T> values, size_t width, std::string_view field) {
  // Nearly always all are: a pass without an early end takes many at a time. NaN fails, too.
  int outside = 0;
  for (const T value : values) outside |= !(std::abs(value) <= std::numeric_limits<T>::max());
  if (outside == 0) return absl::OkStatus();
  const auto bad =
      std::find_if(values.begin(), values.end(), [](T value) { return !std::isfinite(value); });
  const size_t index = (bad - values.begin()) / width;
  const auto element = values.subspan(index * width, width);
  return InvalidField(field, static_cast<int64_t>(index),
                      absl::StrCat("(", absl::StrJoin(element, ", "), ")"), "finite numbers");
}

}  // namespace

absl::StatusOr<size_t> ElementCount(std::string_view bytes, size_t value_bytes, size_t width,
                                    std::string_view field) {
  const size_t element_bytes = value_bytes * width;
  if (bytes.size() % element_bytes != 0) {
    return InvalidField(field, -1, absl::StrCat(bytes.size(), " bytes"),
                        absl::StrCat("a multiple of ", element_bytes, " bytes"));
  }
  return bytes.size() / element_bytes;
}

absl::Status CheckFinite(absl::Span<const float> values, size_t width, std::string_view field) {
  return CheckAllFinite(values, width, field);
}

absl::Status CheckFinite(absl::Span<const double> values, size_t width, std::string_view field) {
  return CheckAllFinite(values, width, field);
}

}  // namespace clearance::wire
