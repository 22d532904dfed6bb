#include "proto/wire/ids.h"

#include <algorithm>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "proto/wire/status_details.h"

namespace clearance::wire {
namespace {

constexpr size_t kMaxNameLength = 63;

bool IsName(std::string_view name) {
  if (name.empty() || name.size() > kMaxNameLength || name[0] < 'a' || name[0] > 'z') return false;
  return std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  });
}

}  // namespace

absl::StatusOr<std::string> NameFromProto(std::string_view name, std::string_view field) {
  if (name.empty()) return std::string(kDefaultName);
  if (!IsName(name)) {
    const std::string shown =
        absl::CHexEscape(absl::string_view(name.data(), std::min<size_t>(name.size(), 80)));
    return InvalidField(field, -1, absl::StrCat("\"", shown, "\""),
                        "a lower-case letter, then up to 62 of a-z, 0-9, _ and -");
  }
  return std::string(name);
}

absl::StatusOr<ObjectId> ObjectIdFromProto(uint32_t id, std::string_view field, int64_t index) {
  if (id == 0 || id > 65535) {
    return InvalidField(field, index, absl::StrCat(id), "an object id from 1 to 65535");
  }
  return ObjectId(static_cast<uint16_t>(id));
}

}  // namespace clearance::wire
