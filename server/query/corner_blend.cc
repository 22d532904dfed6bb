#include "server/query/corner_blend.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

namespace clearance {
namespace {

// Nearer than this the blend of surfels alone counts, beyond the second bound the sites alone.
// Measured on planes, spheres, boxes, corners and poles: mean error 0.01 to 0.05 voxel.
constexpr float kBlendOnlyVoxels = 1.5f;
constexpr float kSitesOnlyVoxels = 2.5f;
// A disc's radius shrinks with the centre's distance, so that the coarse normals do not tilt it.
constexpr float kDiscRadiusVoxels = 0.5f;
constexpr float kFullDiscVoxels = 1.f;
constexpr float kNoDiscVoxels = 3.f;
constexpr float kNowhere = 1e30f;

constexpr float kCornerX[8] = {0, 0, 0, 0, 1, 1, 1, 1};
constexpr float kCornerY[8] = {0, 0, 1, 1, 0, 0, 1, 1};
constexpr float kCornerZ[8] = {0, 1, 0, 1, 0, 1, 0, 1};

struct NormalTable {
  alignas(64) float xyz[128][4];
  NormalTable() {
    for (int code = 0; code < 128; ++code) {
      const Eigen::Vector3f n = NormalOfCode(code);
      for (int axis = 0; axis < 3; ++axis) xyz[code][axis] = n[axis];
      xyz[code][3] = 0;
    }
  }
};
const NormalTable& Normals() {
  static const NormalTable table;
  return table;
}

// Vectors from the voxel centres to their sites, in voxels, and from the point to the sites.
struct Lanes {
  alignas(32) float dx[8], dy[8], dz[8];
  alignas(32) float ex[8], ey[8], ez[8];
  alignas(32) float squared[8];  // |e|^2, kNowhere without a site
  alignas(32) int32_t attributes[8];
};

void Unpack(const FieldVoxel corners[8], const float fraction[3], Lanes& lanes) {
  alignas(32) uint64_t words[8];
  std::memcpy(words, corners, sizeof(words));
  alignas(32) int32_t low[8], high[8];
  for (int k = 0; k < 8; ++k) low[k] = static_cast<int32_t>(words[k]);
  for (int k = 0; k < 8; ++k) high[k] = static_cast<int32_t>(words[k] >> 32);
  for (int k = 0; k < 8; ++k) {
    const int32_t ix = static_cast<int32_t>(static_cast<uint32_t>(low[k]) << 16) >> 16;
    const int32_t iy = low[k] >> 16;
    const int32_t iz = static_cast<int32_t>(static_cast<uint32_t>(high[k]) << 16) >> 16;
    lanes.attributes[k] = static_cast<int32_t>(static_cast<uint32_t>(high[k]) >> 16);
    lanes.dx[k] = static_cast<float>(ix) * FieldVoxel::kUnit;
    lanes.dy[k] = static_cast<float>(iy) * FieldVoxel::kUnit;
    lanes.dz[k] = static_cast<float>(iz) * FieldVoxel::kUnit;
    lanes.ex[k] = lanes.dx[k] + (kCornerX[k] - fraction[0]);
    lanes.ey[k] = lanes.dy[k] + (kCornerY[k] - fraction[1]);
    lanes.ez[k] = lanes.dz[k] + (kCornerZ[k] - fraction[2]);
    const float squared =
        lanes.ex[k] * lanes.ex[k] + lanes.ey[k] * lanes.ey[k] + lanes.ez[k] * lanes.ez[k];
    lanes.squared[k] = ix == FieldVoxel::kNoSite ? kNowhere : squared;
  }
}

// Trilinear weights and their derivatives by x, y and z.
struct Trilinear {
  alignas(32) float w[8], wx[8], wy[8], wz[8];
  explicit Trilinear(const float f[3]) {
    for (int k = 0; k < 8; ++k) {
      const float sx = 2 * kCornerX[k] - 1, sy = 2 * kCornerY[k] - 1, sz = 2 * kCornerZ[k] - 1;
      const float ax = (1 - kCornerX[k]) + sx * f[0];
      const float ay = (1 - kCornerY[k]) + sy * f[1];
      const float az = (1 - kCornerZ[k]) + sz * f[2];
      w[k] = ax * ay * az;
      wx[k] = sx * ay * az;
      wy[k] = ax * sy * az;
      wz[k] = ax * ay * sz;
    }
  }
};

// Signed distance of each centre to its surfel.
void SurfelDistances(const Lanes& lanes, float distance[8]) {
  alignas(32) float nx[8], ny[8], nz[8];
  const NormalTable& table = Normals();
  for (int k = 0; k < 8; ++k) {
    const float* n = table.xyz[(lanes.attributes[k] >> 9) & 127];
    nx[k] = n[0];
    ny[k] = n[1];
    nz[k] = n[2];
  }
  for (int k = 0; k < 8; ++k) {
    const float squared =
        lanes.dx[k] * lanes.dx[k] + lanes.dy[k] * lanes.dy[k] + lanes.dz[k] * lanes.dz[k];
    const float height = nx[k] * lanes.dx[k] + ny[k] * lanes.dy[k] + nz[k] * lanes.dz[k];
    const float fade = (kNoDiscVoxels - std::sqrt(squared)) / (kNoDiscVoxels - kFullDiscVoxels);
    const float radius = kDiscRadiusVoxels * std::min(1.f, std::max(0.f, fade));
    const float lateral = std::sqrt(std::max(0.f, squared - height * height));
    const float beyond = std::max(0.f, lateral - radius);
    const float d = std::sqrt(height * height + beyond * beyond);
    distance[k] = (lanes.attributes[k] & 8) ? -d : d;
  }
}

float Dot(const float a[8], const float b[8]) {
  float sum = 0;
  for (int k = 0; k < 8; ++k) sum += a[k] * b[k];
  return sum;
}

Eigen::Vector3f UnitOrZero(const Eigen::Vector3f& v) {
  const float norm = v.norm();
  return norm > 1e-6f ? Eigen::Vector3f(v / norm) : Eigen::Vector3f::Zero();
}

// Where the centres disagree about the side: the sign of the blended distance to the sites.
bool BlendedSideIsNegative(const Lanes& lanes, const float fraction[3]) {
  const Trilinear blend(fraction);
  float sum = 0;
  for (int k = 0; k < 8; ++k) {
    if (lanes.squared[k] >= kNowhere) continue;
    const float d = std::sqrt(lanes.dx[k] * lanes.dx[k] + lanes.dy[k] * lanes.dy[k] +
                              lanes.dz[k] * lanes.dz[k]);
    sum += blend.w[k] * ((lanes.attributes[k] & 8) ? -d : d);
  }
  return sum < 0;
}

}  // namespace

void BlendCorners(const FieldVoxel corners[8], const float fraction[3], StaticAnswer* answer) {
  Lanes lanes;
  Unpack(corners, fraction, lanes);
  int best = 0;
  for (int k = 1; k < 8; ++k) best = lanes.squared[k] < lanes.squared[best] ? k : best;
  const float squared = lanes.squared[best];
  answer->has_site = squared < kNowhere;
  if (!answer->has_site) {
    answer->gradient_W.setZero();
    answer->distance_voxels = 0;
    return;
  }
  answer->sigma_code = static_cast<uint8_t>((lanes.attributes[best] >> 4) & 31);

  int all = 8, any = 0;
  float farthest = 0;
  for (int k = 0; k < 8; ++k) {
    all &= lanes.attributes[k];
    any |= lanes.attributes[k];
    farthest = std::max(farthest, lanes.squared[k]);
  }
  const float to_site = std::sqrt(squared);
  bool negative = all & 8;
  if (to_site < kSitesOnlyVoxels && farthest < kNowhere) {
    const Trilinear blend(fraction);
    alignas(32) float distance[8];
    SurfelDistances(lanes, distance);
    const float blended = Dot(blend.w, distance);
    const Eigen::Vector3f slope =
        UnitOrZero({Dot(blend.wx, distance), Dot(blend.wy, distance), Dot(blend.wz, distance)});
    if (to_site <= kBlendOnlyVoxels) {
      answer->distance_voxels = blended;
      answer->gradient_W = slope;
      return;
    }
    // Surfaces farther than 1.5 voxels cannot cross the cell: here a change of side between the
    // centres is a border of knowledge, and the blended sign is as good as any.
    const float share = (kSitesOnlyVoxels - to_site) / (kSitesOnlyVoxels - kBlendOnlyVoxels);
    const float sign = blended < 0 ? -1.f : 1.f;
    const Eigen::Vector3f away =
        Eigen::Vector3f(lanes.ex[best], lanes.ey[best], lanes.ez[best]) * (-sign / to_site);
    answer->distance_voxels = share * blended + (1 - share) * sign * to_site;
    answer->gradient_W = UnitOrZero(share * slope + (1 - share) * away);
    return;
  }
  if (negative != static_cast<bool>(any & 8)) negative = BlendedSideIsNegative(lanes, fraction);
  const float sign = negative ? -1.f : 1.f;
  answer->distance_voxels = sign * to_site;
  answer->gradient_W =
      to_site > 1e-6f
          ? Eigen::Vector3f(Eigen::Vector3f(lanes.ex[best], lanes.ey[best], lanes.ez[best]) *
                            (-sign / to_site))
          : Eigen::Vector3f(sign * NormalOfCode((lanes.attributes[best] >> 9) & 127));
}

}  // namespace clearance
