#include "server/integration/band_value.h"

#include <algorithm>
#include <cmath>

namespace clearance {
namespace {

// Lengths in voxels.
constexpr float kNearPlane = 0.7f;  // so near, the plane's own signed distance is the better one
constexpr float kPlaneDecides = 0.35f;  // so near, the plane decides the sign as well
constexpr float kSightTolerance = 2.f;  // unless the sensor looked this far past the point
constexpr float kAcrossTolerance = 0.5f;
constexpr float kMostAside = 1.0f;      // of the foot: farther, the plane is an extrapolation
constexpr float kDeepest = 1.75f;       // what lies deeper behind a surface says nothing about it
constexpr float kDeepestAtEdge = 0.6f;  // behind a silhouette the surface turns away or ends

constexpr float kGuessDepth = 0.5f;
constexpr float kGuessAgainstSeen = 0.02f;  // factor
constexpr float kMostGuessed = 2.f;        // weight

float Signed(bool outside, float distance_m) { return outside ? distance_m : -distance_m; }

}  // namespace

std::optional<BandValue> DecideBandValue(const Sight& sight, float along_normal_m, float distance_m,
                                         float cos_view, float variance, uint16_t id,
                                         float voxel_size_m) {
  const float near = std::abs(along_normal_m) / voxel_size_m;
  const float aside =
      std::sqrt(std::max(0.f, distance_m * distance_m - along_normal_m * along_normal_m)) /
      voxel_size_m;
  BandValue out{along_normal_m, 1.f - variance};
  if (!sight.usable) {
    // Between sparse rays only the plane is left to tell the sides; far beside its points it is not
    // to be trusted.
    if (aside > kMostAside) return std::nullopt;
  } else {
    const float in_front = sight.in_front_m / voxel_size_m;
    const bool outside = in_front > 0;
    if (!outside && sight.label != id) return std::nullopt;  // hidden by something else
    const bool consistent =
        std::abs(in_front) < kSightTolerance || std::abs(in_front) * cos_view < kAcrossTolerance;
    const bool agree = outside == (along_normal_m > 0);
    const bool plane =
        aside < kMostAside && (agree ? near < kNearPlane : near < kPlaneDecides && consistent);
    if (!plane) out.distance_m = Signed(outside, distance_m);
  }
  if (out.distance_m < 0) {
    const float depth = -out.distance_m / voxel_size_m;
    // Beyond the end of the surface, not behind it.
    if (aside > std::max(kMostAside, near)) return std::nullopt;
    if (depth > kDeepest || (sight.edge_beyond && depth > kDeepestAtEdge)) return std::nullopt;
    // Seen from another side, what is hidden here may be empty: let that side win.
    out.weight *= std::max(0.f, 1.f - depth / 2.f);
  }
  if (!(out.weight > 0)) return std::nullopt;
  return out;
}

float GuessedWeight(const BandValue& value, float stored_mean_m, float stored_weight,
                    float voxel_size_m) {
  if (value.distance_m > -kGuessDepth * voxel_size_m || stored_weight <= 0) return value.weight;
  if (stored_mean_m > 0) return kGuessAgainstSeen * value.weight;
  return std::min(value.weight, std::max(0.f, kMostGuessed - stored_weight));
}

}  // namespace clearance
