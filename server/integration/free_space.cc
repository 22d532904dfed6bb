#include "server/integration/free_space.h"

#include "server/integration/free_space_parts.h"

namespace clearance {

std::vector<FreeBlock> ObserveFreeSpace(const RangeImage& image, const Pose& T_W_X,
                                        const SurfaceMap& static_map,
                                        const FreeSpaceOptions& options) {
  if (image.width() == 0 || image.height() == 0) return {};
  return image.is_pinhole() ? ObserveFreeSpacePinhole(image, T_W_X, static_map, options)
                            : ObserveFreeSpaceRays(image, T_W_X, static_map, options);
}

}  // namespace clearance
