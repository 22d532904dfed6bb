// Surfaces of objects as bytes, for whoever follows a map or keeps it. Versioned with
// server/map/field_codec.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "server/map/object_shape.h"

namespace clearance {

inline constexpr size_t kSiteBytes = 28;
using Sites = std::vector<SurfaceSite>;

// By the bits of all values: only sites that are the same in every bit are equal.
bool ComesFirst(const SurfaceSite& a, const SurfaceSite& b);

// Appends sites [first, first + count): position, normal, sigma as floats.
void AppendSites(const Sites& sites, size_t first, size_t count, std::string* bytes);
// Appends the sites to `sites`. DATA_LOSS for a length that is not a whole number of sites and for
// values that no site has: not finite, farther than 100 km, a normal that is not of unit length, a
// sigma beyond 0 to 1 km.
absl::Status ReadSites(std::string_view bytes, Sites* sites);

// Appends what a reader of `before` lacks of `after`: a bit for each site of `before`, set where it
// stays, and the sites that are new. Their order is lost; a shape does not depend on it. Returns
// false, with nothing appended, where less than half stays: then the whole is no longer.
bool AppendSiteChanges(const Sites& before, const Sites& after, std::string* bytes);
absl::Status ReadSiteChanges(std::string_view bytes, const Sites& before, Sites* sites);

}  // namespace clearance
