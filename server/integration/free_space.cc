#include "server/integration/free_space.h"

#include "server/integration/free_space_parts.h"

namespace clearance {

namespace {

// Adds the returns to the observed blocks, and blocks that hold nothing else.
std::vector<FreeBlock> WithReturns(std::vector<FreeBlock> free, const StaticReturns& returns) {
  std::vector<FreeBlock> all;
  all.reserve(free.size() + returns.blocks().size() / 4);
  size_t i = 0, j = 0;
  const std::vector<BlockIndex>& hit = returns.blocks();
  while (i < free.size() || j < hit.size()) {
    const bool take_free = j == hit.size() || (i < free.size() && free[i].block <= hit[j]);
    FreeBlock& block = all.emplace_back();
    if (take_free) {
      block = free[i++];
    } else {
      block.block = hit[j];
    }
    if (j == hit.size() || block.block != hit[j]) continue;
    block.hit = returns.In(hit[j++]);
    for (size_t w = 0; w < block.hit.size(); ++w) {
      block.confident[w] &= ~block.hit[w];
      block.probable[w] &= ~block.hit[w];
      block.contradicted[w] &= ~block.hit[w];
      block.refuted[w] &= ~block.hit[w];
    }
  }
  return all;
}

}  // namespace

std::vector<FreeBlock> ObserveFreeSpace(const RangeImage& image, const Pose& T_W_X,
                                        const LocalVoxels& static_voxels,
                                        const SurfaceMap& static_map,
                                        const FreeSpaceOptions& options) {
  const StaticReturns returns(static_voxels);
  std::vector<FreeBlock> free;
  if (image.width() > 0 && image.height() > 0) {
    free = image.is_pinhole() ? ObserveFreeSpacePinhole(image, T_W_X, returns, static_map, options)
                              : ObserveFreeSpaceRays(image, T_W_X, returns, static_map, options);
  }
  return WithReturns(std::move(free), returns);
}

}  // namespace clearance
