#include "server/map/free_evidence.h"

namespace clearance {

bool IsConfidentlyFree(const int32_t* evidence, const float* weight, int h,
                       const FreeRules& rules) {
  if (FreeEvidence::Unpack(evidence[h]).confident < rules.min_confident_frames) return false;
  for (int dx = -1; dx <= 1; ++dx) {
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dz = -1; dz <= 1; ++dz) {
        const int n = h + (dx * kHaloSide + dy) * kHaloSide + dz;
        if (evidence[n] == 0 && !(weight[n] > 0.f)) return false;  // never observed
      }
    }
  }
  return true;
}

}  // namespace clearance
