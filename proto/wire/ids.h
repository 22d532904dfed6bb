// Names of maps, sources and objects.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "server/core/object_id.h"

namespace clearance::wire {

inline constexpr std::string_view kDefaultName = "default";

// The id of a map or a source: [a-z][a-z0-9_-]{0,62}; empty is `default`. INVALID_ARGUMENT naming
// `field` otherwise.
absl::StatusOr<std::string> NameFromProto(std::string_view name, std::string_view field);

// 1..65535; INVALID_ARGUMENT naming `field` and, where not negative, `index`.
absl::StatusOr<ObjectId> ObjectIdFromProto(uint32_t id, std::string_view field, int64_t index = -1);

}  // namespace clearance::wire
