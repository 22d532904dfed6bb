// When counted evidence means free, and how sure that is.
#pragma once

#include <cstdint>

#include "server/map/surface_map.h"

namespace clearance {

struct FreeRules {
  uint8_t min_probable_frames = 1;   // FREE at low confidence from here on
  uint8_t min_confident_frames = 3;  // high confidence from here on, with 26 observed neighbours
};

// Whether a voxel's evidence alone means free (a surface in the cube outranks it; the caller decides).
inline bool IsFree(FreeEvidence e, const FreeRules& rules = {}) {
  return e.probable >= rules.min_probable_frames;
}

// High confidence: seen wholly empty in several frames, and each of the 26 neighbours was observed
// (evidence or band weight). `evidence` and `weight` are halo blocks, `h` a HaloOffset inside 0..7.
bool IsConfidentlyFree(const int32_t* evidence, const float* weight, int h,
                       const FreeRules& rules = {});

}  // namespace clearance
