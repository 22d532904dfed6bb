#include "server/query/static_lookup.h"

#include <array>
#include <cmath>
#include <cstring>

#include "server/query/corner_blend.h"

namespace clearance {
namespace {

// Voxels without a site, by the attribute bits 0-2 that a tile holds: a pointer to a voxel always
// has something to point at.
constexpr std::array<FieldVoxel, 8> kAbsent = [] {
  std::array<FieldVoxel, 8> voxels{};
  for (uint16_t state = 0; state < 8; ++state) voxels[state].attributes = state;
  return voxels;
}();

// A block's voxels, or one voxel that stands for all of them.
struct BlockVoxels {
  const FieldVoxel* first;
  bool uniform;

  const FieldVoxel* At(int offset) const { return uniform ? first : first + offset; }
};

BlockVoxels VoxelsOf(const DistanceField::Region* region, int block) {
  if (region == nullptr) return {&kAbsent[0], true};
  const FieldBlock* data = region->blocks[block].get();
  if (data != nullptr) return {data->voxels.data(), false};
  const uint8_t tile = region->tiles[block];
  return {&kAbsent[tile == DistanceField::kNoTile ? 0 : tile & 7], true};
}

// The cell of voxel centres that holds a point, on its way through the stages.
struct Cell {
  VoxelIndex low;     // voxel of corner 0
  float fraction[3];  // of the point, from corner 0, in voxels
  int own;            // corner of the point's own voxel
  int across;         // axes on which the cell reaches into the next block: bits 4 x, 2 y, 1 z
  bool one_value;     // with across = 0: no data there, every corner is *corners[0]
  const DistanceField::Region* region;  // of corner 0
  const FieldVoxel* corners[8];         // with across = 0 only the first is set
};

constexpr int kCornerOffset[8] = {0, 1, 8, 9, 64, 65, 72, 73};

void LocateCell(const Eigen::Vector3d& point_W, double voxel_size_m, Cell& cell) {
  cell.own = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double u = point_W[axis] / voxel_size_m - 0.5;
    const double low = std::floor(u);
    cell.low[axis] = static_cast<int>(low);
    cell.fraction[axis] = static_cast<float>(u - low);
    cell.own = cell.own * 2 + (u - low >= 0.5 ? 1 : 0);
  }
  cell.across =
      ((cell.low.x() & 7) == 7) << 2 | ((cell.low.y() & 7) == 7) << 1 | ((cell.low.z() & 7) == 7);
}

BlockIndex RegionOf(const BlockIndex& block) { return {block.x >> 3, block.y >> 3, block.z >> 3}; }

void Gather(const Cell& cell, FieldVoxel corners[8]) {
  if (cell.across != 0) {
    // Written by pairs, as they are read.
    for (int k = 0; k < 8; k += 2) {
      const std::array<FieldVoxel, 2> pair = {*cell.corners[k], *cell.corners[k + 1]};
      std::memcpy(static_cast<void*>(&corners[k]), pair.data(), sizeof(pair));
    }
  } else if (cell.one_value) {
    for (int k = 0; k < 8; ++k) corners[k] = *cell.corners[0];
  } else {
    for (int row = 0; row < 4; ++row) {
      std::memcpy(&corners[2 * row], cell.corners[0] + kCornerOffset[2 * row],
                  2 * sizeof(FieldVoxel));
    }
  }
}

BlockIndex Stepped(const BlockIndex& block, int axes) {
  return {block.x + (axes >> 2), block.y + (axes >> 1 & 1), block.z + (axes & 1)};
}

// From a voxel's offset to that of corner k, where the axes of `wraps` enter the next block.
int CornerStep(int k, int wraps) {
  return kCornerOffset[k] - ((wraps >> 2) * 512 + (wraps >> 1 & 1) * 64 + (wraps & 1) * 8);
}

}  // namespace

StaticLookup::StaticLookup(const DistanceField& field)
    : field_(field), limit_m_((1 << 30) * field.voxel_size_m()) {}

void StaticLookup::Answer(const Eigen::Vector3d* points_W, int count, StaticAnswer* answers) {
  // Three dependent reads lie between a point and its voxels (region, block pointer, voxels): each
  // stage asks for the memory of the next for the whole group.
  Cell cells[kLookupGroup];
  for (int i = 0; i < count; ++i) {
    Cell& cell = cells[i];
    LocateCell(points_W[i], field_.voxel_size_m(), cell);
    const BlockIndex block = BlockOf(cell.low);
    cell.region = FindRegion(RegionOf(block));
    if (cell.region == nullptr) continue;
    const int offset = DistanceField::RegionOffset(block);
    __builtin_prefetch(&cell.region->blocks[offset]);
    if (cell.across == 0) continue;
    // The farthest neighbour's pointer; the ones between mostly share a line with either. Wrong at
    // a region's border, where it only fetches in vain.
    const int step = DistanceField::RegionOffset(Stepped(block, cell.across));
    __builtin_prefetch(&cell.region->blocks[step]);
    __builtin_prefetch(&cell.region->blocks[(offset & 0700) | (step & 077)]);
    __builtin_prefetch(&cell.region->blocks[(step & 0700) | (offset & 077)]);
  }
  for (int i = 0; i < count; ++i) {
    Cell& cell = cells[i];
    const BlockIndex block = BlockOf(cell.low);
    const int offset = OffsetOf(cell.low);
    const BlockVoxels own = VoxelsOf(cell.region, DistanceField::RegionOffset(block));
    cell.corners[0] = own.At(offset);
    if (cell.across == 0) {
      cell.one_value = own.uniform;
      if (own.uniform) continue;
      for (int row = 0; row < 4; ++row) {
        __builtin_prefetch(cell.corners[0] + kCornerOffset[2 * row]);
      }
      continue;
    }
    // Each block that the cell reaches into, once: the subsets of `across`, rising.
    BlockVoxels blocks[8];
    blocks[0] = own;
    for (int axes = -cell.across & cell.across; axes != 0;
         axes = (axes - cell.across) & cell.across) {
      const BlockIndex other = Stepped(block, axes);
      blocks[axes] = VoxelsOf(FindRegion(RegionOf(other)), DistanceField::RegionOffset(other));
    }
    for (int k = 0; k < 8; ++k) {
      const int axes = k & cell.across;
      cell.corners[k] = blocks[axes].At(offset + CornerStep(k, axes));
      __builtin_prefetch(cell.corners[k]);
    }
  }
  for (int i = 0; i < count; ++i) {
    const Cell& cell = cells[i];
    FieldVoxel corners[8];
    Gather(cell, corners);
    BlendCorners(corners, cell.fraction, &answers[i]);
    answers[i].state = corners[cell.own].attributes & 7;
  }
}

}  // namespace clearance
