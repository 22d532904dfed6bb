// Relaxation of one 8^3 block of the closest-site field by line scans.
#pragma once

#include <array>
#include <cstdint>

#include "server/map/distance_field.h"

namespace clearance {

// Faces in the order -x, +x, -y, +y, -z, +z; the opposite of face f is f ^ 1.
inline constexpr int kFaces = 6;
inline constexpr int kFaceStep[kFaces][3] = {{-1, 0, 0}, {1, 0, 0},  {0, -1, 0},
                                             {0, 1, 0},  {0, 0, -1}, {0, 0, 1}};

// Squared length of the vector to the site, in (1/256 voxel)^2. More than any limit without a site.
inline int32_t SquaredUnits(const FieldVoxel& v) {
  return int32_t{v.dx} * v.dx + int32_t{v.dy} * v.dy + int32_t{v.dz} * v.dz;
}

// Square of the farthest distance that is stored, in (1/256 voxel)^2.
int32_t SquaredLimit(double max_distance_m, double voxel_size_m);

struct SweepResult {
  bool changed = false;
  uint8_t wake = 0;  // bit f: the neighbour across face f can be improved
};

// Offers every voxel its face neighbours' sites until nothing improves, in this block and from the
// facing layers of its neighbours (null: absent). A voxel takes a site that is strictly nearer and
// not beyond `squared_limit`; the attributes of the site come along, those of the voxel stay. The
// bytes depend on nothing but the arguments. `block` is written only when changed.
// `faces`: the neighbours that may have something to offer; the others had nothing when both were
// last compared and have not changed since. Of those, a neighbour is compared again only where the
// layer that faces it changed, which finds the same and spares reading them.
inline constexpr uint8_t kAllFaces = (1 << kFaces) - 1;
SweepResult SweepBlock(const std::array<const FieldBlock*, kFaces>& neighbours,
                       int32_t squared_limit, FieldBlock* block, uint8_t faces = kAllFaces);

}  // namespace clearance
