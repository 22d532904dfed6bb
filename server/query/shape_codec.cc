#include "server/query/shape_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>

#include "absl/strings/str_format.h"

namespace clearance {
namespace {

constexpr size_t kValues = 7;
using Values = std::array<float, kValues>;
static_assert(sizeof(Values) == kSiteBytes);

Values ValuesOf(const SurfaceSite& s) {
  return {s.p_L.x(),      s.p_L.y(),      s.p_L.z(), s.normal_L.x(),
          s.normal_L.y(), s.normal_L.z(), s.sigma_m};
}

// Bounds of queries are floats: what is absurdly far or large would make them meaningless.
constexpr float kMaxReach_m = 1e5f, kMaxSigma_m = 1e3f, kNormalTolerance = 0.01f;

bool IsSite(const SurfaceSite& site) {
  return site.p_L.cwiseAbs().maxCoeff() <= kMaxReach_m && site.p_L.allFinite() &&
         std::abs(site.normal_L.norm() - 1) <= kNormalTolerance && site.sigma_m >= 0 &&
         site.sigma_m <= kMaxSigma_m;
}

std::vector<uint32_t> Sorted(const Sites& sites) {
  std::vector<uint32_t> order(sites.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](uint32_t a, uint32_t b) { return ComesFirst(sites[a], sites[b]); });
  return order;
}

}  // namespace

bool ComesFirst(const SurfaceSite& a, const SurfaceSite& b) {
  using Bits = std::array<uint32_t, kValues>;
  return std::bit_cast<Bits>(ValuesOf(a)) < std::bit_cast<Bits>(ValuesOf(b));
}

void AppendSites(const Sites& sites, size_t first, size_t count, std::string* bytes) {
  // Byte by byte over all sites: exponents and signs repeat, and compress.
  const size_t start = bytes->size();
  bytes->resize(start + count * kSiteBytes);
  char* out = bytes->data() + start;
  for (size_t i = 0; i < count; ++i) {
    const auto raw = std::bit_cast<std::array<char, kSiteBytes>>(ValuesOf(sites[first + i]));
    for (size_t byte = 0; byte < kSiteBytes; ++byte) out[byte * count + i] = raw[byte];
  }
}

absl::Status ReadSites(std::string_view bytes, Sites* sites) {
  if (bytes.size() % kSiteBytes != 0) {
    return absl::DataLossError(
        absl::StrFormat("object surface: %d bytes are no whole number of sites of %d bytes",
                        bytes.size(), kSiteBytes));
  }
  const size_t count = bytes.size() / kSiteBytes;
  sites->reserve(sites->size() + count);
  for (size_t i = 0; i < count; ++i) {
    std::array<char, kSiteBytes> raw;
    for (size_t byte = 0; byte < kSiteBytes; ++byte) raw[byte] = bytes[byte * count + i];
    const auto v = std::bit_cast<Values>(raw);
    const SurfaceSite site{{v[0], v[1], v[2]}, {v[3], v[4], v[5]}, v[6]};
    if (!IsSite(site)) {
      return absl::DataLossError(absl::StrFormat(
          "object surface: site %d is at (%g, %g, %g) with a normal of length %g and "
          "sigma %g: no surface of an object",
          i, v[0], v[1], v[2], site.normal_L.norm(), site.sigma_m));
    }
    sites->push_back(site);
  }
  return absl::OkStatus();
}

bool AppendSiteChanges(const Sites& before, const Sites& after, std::string* bytes) {
  const std::vector<uint32_t> old_order = Sorted(before), new_order = Sorted(after);
  std::string stays((before.size() + 7) / 8, '\0');
  Sites added;
  size_t o = 0;
  for (const uint32_t n : new_order) {
    while (o < old_order.size() && ComesFirst(before[old_order[o]], after[n])) ++o;
    if (o < old_order.size() && !ComesFirst(after[n], before[old_order[o]])) {
      const uint32_t index = old_order[o++];
      stays[index / 8] = static_cast<char>(stays[index / 8] | 1 << (index % 8));
    } else {
      added.push_back(after[n]);
    }
  }
  if (added.size() * 2 > after.size()) return false;
  bytes->append(stays);
  AppendSites(added, 0, added.size(), bytes);
  return true;
}

absl::Status ReadSiteChanges(std::string_view bytes, const Sites& before, Sites* sites) {
  const size_t flags = (before.size() + 7) / 8;
  if (bytes.size() < flags) {
    return absl::DataLossError(
        absl::StrFormat("object surface: %d bytes, %d say which of %d sites stay", bytes.size(),
                        flags, before.size()));
  }
  for (size_t i = 0; i < before.size(); ++i) {
    if (bytes[i / 8] >> (i % 8) & 1) sites->push_back(before[i]);
  }
  return ReadSites(bytes.substr(flags), sites);
}

}  // namespace clearance
