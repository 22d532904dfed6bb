#include "server/map/observed_voxels.h"

#include <algorithm>
#include <cstring>

#include "server/map/surface_grids.h"

namespace clearance {
namespace {

openvdb::Coord CoordOf(const BlockIndex& b) { return {b.x * 8, b.y * 8, b.z * 8}; }

// Not registered with the tree, which costs more than the reads of one block: the tree stands still
// while this lives.
template <typename Tree>
using ReadAccessor = openvdb::tree::ValueAccessor<const Tree, false>;

// Adds the active voxels of a block. OpenVDB's leaf masks have our offsets, eight words of 64.
template <typename Tree>
void AddActive(const ReadAccessor<Tree>& accessor, const BlockIndex& block, BlockMask* mask) {
  const openvdb::Coord ijk = CoordOf(block);
  if (const auto* leaf = accessor.probeConstLeaf(ijk)) {
    for (int w = 0; w < 8; ++w) (*mask)[w] |= leaf->valueMask().template getWord<uint64_t>(w);
  } else if (accessor.isValueOn(ijk)) {
    *mask = kFullMask;
  }
}

}  // namespace

void ReadObserved(const SurfaceMap& map, const BlockIndex& block, ObservedVoxels* observed) {
  const ReadAccessor<openvdb::FloatTree> weights(map.grids().weight->constTree());
  const ReadAccessor<openvdb::Int32Tree> evidences(map.grids().evidence->constTree());
  observed->any = {};
  for (int d = 0; d < 27; ++d) {
    const BlockIndex b{block.x + d / 9 - 1, block.y + d / 3 % 3 - 1, block.z + d % 3 - 1};
    AddActive<openvdb::FloatTree>(weights, b, &observed->any[d]);
    if (d == 13) observed->band = observed->any[d];
    AddActive<openvdb::Int32Tree>(evidences, b, &observed->any[d]);
  }
}

void ReadOwnEvidence(const SurfaceMap& map, const BlockIndex& block,
                     int32_t evidence[kBlockVoxels]) {
  const openvdb::Coord ijk = CoordOf(block);
  const auto& tree = map.grids().evidence->constTree();
  if (const auto* leaf = tree.probeConstLeaf(ijk)) {
    std::memcpy(evidence, leaf->buffer().data(), kBlockVoxels * sizeof(int32_t));
  } else {
    std::fill(evidence, evidence + kBlockVoxels, tree.getValue(ijk));
  }
}

}  // namespace clearance
