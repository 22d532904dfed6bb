#include "server/esdf/site_table.h"

#include <cstdlib>

namespace clearance {
namespace {

bool Moved(const FieldVoxel& from, const FieldVoxel& to) {
  const int x = to.dx - from.dx, y = to.dy - from.dy, z = to.dz - from.dz;
  if (x * x + y * y + z * z > kIgnoredMoveUnits * kIgnoredMoveUnits) return true;
  if (std::abs(to.sigma_code() - from.sigma_code()) > kIgnoredSigmaCodes) return true;
  return to.normal_code() != from.normal_code() &&
         NormalOfCode(to.normal_code()).dot(NormalOfCode(from.normal_code())) <
             kIgnoredNormalCosine;
}

}  // namespace

void SiteBlock::Update(const BlockSites& newest) {
  Settle();
  std::vector<FieldVoxel> sites;
  ForEachSet(newest.mask, [&](int o) {
    const FieldVoxel* known = Find(o);
    const bool moved = known && Moved(*known, newest.site[o]);
    if (!known || moved) Set(fresh_, o);
    if (moved) Set(gone_, o);
    sites.push_back(known && !moved ? *known : newest.site[o]);
  });
  for (int w = 0; w < 8; ++w) gone_[w] |= mask_[w] & ~newest.mask[w];
  if (!changed()) return;
  sites_ = std::move(sites);
  mask_ = newest.mask;
  uint16_t count = 0;
  for (int w = 0; w < 8; ++w) {
    first_[w] = count;
    count += static_cast<uint16_t>(__builtin_popcountll(mask_[w]));
  }
}

}  // namespace clearance
