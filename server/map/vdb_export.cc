#include "server/map/vdb_export.h"

#include <openvdb/io/Stream.h>

#include <sstream>

#include "absl/strings/str_format.h"
#include "server/map/surface_grids.h"

namespace clearance {
namespace {

openvdb::FloatGrid::Ptr Named(const openvdb::FloatGrid& grid, const char* name) {
  openvdb::FloatGrid::Ptr copy = grid.deepCopy();
  copy->setName(name);
  return copy;
}

// Cell-centred: voxel i covers [i h, (i + 1) h).
openvdb::math::Transform::Ptr CellCentred(double voxel_size_m) {
  auto transform = openvdb::math::Transform::createLinearTransform(voxel_size_m);
  transform->postTranslate(openvdb::Vec3d(voxel_size_m / 2));
  return transform;
}

openvdb::Coord FirstCoord(const BlockIndex& block) {
  const VoxelIndex first = FirstVoxel(block);
  return {first.x(), first.y(), first.z()};
}

}  // namespace

openvdb::FloatGrid::Ptr CopyMean(const SurfaceMap& map) { return Named(*map.grids().mean, "mean"); }

openvdb::FloatGrid::Ptr CopyWeight(const SurfaceMap& map) {
  return Named(*map.grids().weight, "weight");
}

openvdb::FloatGrid::Ptr DistanceGrid(const DistanceField& field) {
  const float voxel_size_m = static_cast<float>(field.voxel_size_m());
  auto grid = openvdb::FloatGrid::create(static_cast<float>(field.max_distance_m()));
  grid->setName("distance");
  grid->setTransform(CellCentred(field.voxel_size_m()));
  field.ForEach(
      [&](const BlockIndex& index, const std::shared_ptr<const FieldBlock>& block, uint8_t) {
        if (!block) return;
        openvdb::FloatTree::LeafNodeType* leaf = grid->tree().touchLeaf(FirstCoord(index));
        for (int offset = 0; offset < kBlockVoxels; ++offset) {
          const FieldVoxel& voxel = block->voxels[offset];
          if (!voxel.has_site()) continue;
          const float distance_m = voxel.to_site_voxels().norm() * voxel_size_m;
          leaf->setValueOn(offset, voxel.negative() ? -distance_m : distance_m);
        }
      });
  return grid;
}

openvdb::Int32Grid::Ptr FreeSpaceGrid(const DistanceField& field) {
  auto grid = openvdb::Int32Grid::create(0);
  grid->setName("free_space");
  grid->setTransform(CellCentred(field.voxel_size_m()));
  field.ForEach(
      [&](const BlockIndex& index, const std::shared_ptr<const FieldBlock>& block, uint8_t tile) {
        if (!block) {
          const int state = tile == DistanceField::kNoTile ? 0 : tile & 3;
          if (state == 0) return;
          const openvdb::Coord first = FirstCoord(index);
          grid->tree().fill({first, first.offsetBy(kBlockSide - 1)}, state, true);
          return;
        }
        openvdb::Int32Tree::LeafNodeType* leaf = grid->tree().touchLeaf(FirstCoord(index));
        for (int offset = 0; offset < kBlockVoxels; ++offset) {
          const VoxelState state = block->voxels[offset].state();
          if (state != VoxelState::kUnknown) leaf->setValueOn(offset, static_cast<int>(state));
        }
      });
  grid->tree().prune();
  return grid;
}

absl::StatusOr<std::string> WriteVdb(const openvdb::GridCPtrVec& grids) try {
  openvdb::initialize();
  std::ostringstream out(std::ios::binary);
  openvdb::io::Stream(out).write(grids);
  if (!out) return absl::InternalError("writing the .vdb file failed");
  return std::move(out).str();
} catch (const std::exception& error) {
  return absl::InternalError(absl::StrFormat("writing the .vdb file failed: %s", error.what()));
}

absl::StatusOr<openvdb::GridPtrVec> ReadVdb(std::string bytes) try {
  openvdb::initialize();
  std::istringstream in(std::move(bytes), std::ios::binary);
  in.exceptions(std::ios::failbit | std::ios::badbit);  // OpenVDB does not look
  return *openvdb::io::Stream(in, /*delayLoad=*/false).getGrids();
} catch (const std::exception& error) {
  return absl::DataLossError(absl::StrFormat("reading the .vdb file failed: %s", error.what()));
}

}  // namespace clearance
