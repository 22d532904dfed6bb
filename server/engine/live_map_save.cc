// LiveMap on its way into a snapshot and out of it. The files:
//   static.vdb        mean_m, weight, free_evidence of the static map
//   objects.vdb       the same of each object, named object_<id>_<generation>.<grid>
//   state.bin         poses, life states, histories, what sources sent: everything beside grids
//   field_table.bin   the distance field's sites and blocks
//   field_blocks.bin  the blocks' voxels
#include <tbb/parallel_invoke.h>

#include <map>

#include "absl/strings/str_format.h"
#include "server/engine/live_map.h"
#include "server/map/surface_grids.h"
#include "server/map/vdb_export.h"
#include "server/query/object_tree.h"
#include "server/query/shape_codec.h"

namespace clearance {
namespace {

constexpr char kStaticFile[] = "static.vdb", kObjectsFile[] = "objects.vdb",
               kStateFile[] = "state.bin", kTableFile[] = "field_table.bin",
               kBlocksFile[] = "field_blocks.bin";

// What the names of a surface's grids start with.
std::string Prefix(ObjectId id, uint32_t generation) {
  if (id.is_static()) return "";
  return absl::StrFormat("object_%d_%d.", id.value(), generation);
}

// Copies: the map goes on meanwhile.
void AddGrids(const std::string& prefix, const SurfaceGrids& grids, openvdb::GridCPtrVec* out) {
  for (const openvdb::GridBase::Ptr& grid :
       {openvdb::GridBase::Ptr(grids.mean), openvdb::GridBase::Ptr(grids.weight),
        openvdb::GridBase::Ptr(grids.evidence)}) {
    const openvdb::GridBase::Ptr copy = grid->deepCopyGrid();
    copy->setName(prefix + grid->getName());
    out->push_back(copy);
  }
}

class FrozenLiveMap final : public FrozenModel {
 public:
  std::string state;
  openvdb::GridCPtrVec static_grids, object_grids;
  FieldUpdater::Saved field;

  absl::Status Write(const FileSink& sink) const override {
    if (absl::Status s = sink(kStateFile, state); !s.ok()) return s;
    if (absl::Status s = WriteGrids(kStaticFile, static_grids, sink); !s.ok()) return s;
    if (absl::Status s = WriteGrids(kObjectsFile, object_grids, sink); !s.ok()) return s;
    if (absl::Status s = sink(kTableFile, field.table); !s.ok()) return s;
    std::string blocks;
    blocks.reserve(field.blocks.size() * sizeof(FieldBlock));
    for (const auto& block : field.blocks) {
      blocks.append(reinterpret_cast<const char*>(block->voxels.data()), sizeof(FieldBlock));
    }
    return sink(kBlocksFile, std::move(blocks));
  }

 private:
  static absl::Status WriteGrids(const char* name, const openvdb::GridCPtrVec& grids,
                                 const FileSink& sink) {
    absl::StatusOr<std::string> bytes = WriteVdb(grids);
    return bytes.ok() ? sink(name, *std::move(bytes)) : bytes.status();
  }
};

using GridsByName = std::map<std::string, openvdb::GridBase::Ptr>;

absl::Status ReadGrids(const FileSource& files, const char* name, GridsByName* grids) {
  absl::StatusOr<std::string> bytes = files(name);
  if (!bytes.ok()) return bytes.status();
  const absl::StatusOr<openvdb::GridPtrVec> read = ReadVdb(*std::move(bytes));
  if (!read.ok()) return read.status();
  for (const openvdb::GridBase::Ptr& grid : *read) (*grids)[grid->getName()] = grid;
  return absl::OkStatus();
}

// The three grids of one surface, with their own names again.
absl::StatusOr<SurfaceMap> TakeSurface(const GridsByName& grids, double voxel_size_m, ObjectId id,
                                       uint32_t generation) {
  const std::string prefix = Prefix(id, generation);
  const auto find = [&](const char* name) -> openvdb::GridBase::Ptr {
    const auto it = grids.find(prefix + name);
    if (it == grids.end()) return nullptr;
    it->second->setName(name);
    return it->second;
  };
  const SurfaceGrids read{openvdb::gridPtrCast<openvdb::FloatGrid>(find("mean_m")),
                          openvdb::gridPtrCast<openvdb::FloatGrid>(find("weight")),
                          openvdb::gridPtrCast<openvdb::Int32Grid>(find("free_evidence"))};
  if (!read.mean || !read.weight || !read.evidence) {
    return absl::DataLossError(absl::StrFormat(
        "the grids %1$smean_m, %1$sweight and %1$sfree_evidence are not all there", prefix));
  }
  SurfaceMap map(voxel_size_m);
  map.grids().mean->setTree(read.mean->treePtr());
  map.grids().weight->setTree(read.weight->treePtr());
  map.grids().evidence->setTree(read.evidence->treePtr());
  return map;
}

absl::StatusOr<FieldUpdater> ReadField(const FileSource& files, const MapConfig& config,
                                       const FusionOptions& fusion) {
  const absl::StatusOr<std::string> table = files(kTableFile);
  if (!table.ok()) return table.status();
  const absl::StatusOr<std::string> blocks = files(kBlocksFile);
  if (!blocks.ok()) return blocks.status();
  return FieldUpdater::Load(config, fusion, *table, *blocks);
}

}  // namespace

std::unique_ptr<FrozenModel> LiveMap::Freeze() {
  auto frozen = std::make_unique<FrozenLiveMap>();
  ByteWriter state;
  world_.Save(&state);
  state.Put<uint64_t>(shapes_.size());
  for (const auto& [key, shape] : shapes_) {
    state.Put(key.first.value());
    state.Put(key.second);
    // Not to be had from the surface again: sites stay where they were published.
    std::string sites;
    AppendSites(shape->sites, 0, shape->sites.size(), &sites);
    state.PutText(sites);
  }
  state.Put<uint8_t>(observed_blocks_.has_value());
  const auto observed = observed_blocks_.value_or(Eigen::AlignedBox<int32_t, 3>());
  state.PutMatrix(observed.min());
  state.PutMatrix(observed.max());
  frozen->state = state.Take();
  AddGrids("", world_.static_map().grids(), &frozen->static_grids);
  const auto add = [&frozen](const ObjectSubmap& object) {
    AddGrids(Prefix(object.id(), object.generation()), object.surface().grids(),
             &frozen->object_grids);
  };
  for (const auto& [id, object] : world_.objects()) add(object);
  for (const ObjectSubmap& object : world_.retired()) add(object);
  frozen->field = updater_.Save();
  return frozen;
}

absl::StatusOr<std::unique_ptr<MapModel>> LiveMap::Load(const MapConfig& config,
                                                        const FileSource& files) {
  auto map = std::make_unique<LiveMap>(config);
  GridsByName grids;
  absl::Status grids_read;
  absl::StatusOr<FieldUpdater> updater = absl::UnknownError("not read");
  tbb::parallel_invoke([&] { updater = ReadField(files, config, map->world_.fusion()); },
                       [&] {
                         grids_read = ReadGrids(files, kStaticFile, &grids);
                         if (grids_read.ok()) grids_read = ReadGrids(files, kObjectsFile, &grids);
                       });
  if (!updater.ok()) return updater.status();
  if (!grids_read.ok()) return grids_read;
  const absl::StatusOr<std::string> state = files(kStateFile);
  if (!state.ok()) return state.status();
  ByteReader in(*state, kStateFile);
  absl::StatusOr<WorldMap> world =
      WorldMap::Load(config, &in, [&](ObjectId id, uint32_t generation) {
        return TakeSurface(grids, config.voxel_size_m, id, generation);
      });
  if (!world.ok()) return world.status();
  map->world_ = *std::move(world);
  map->updater_ = *std::move(updater);
  map->field_ = map->updater_.field();
  for (size_t left = in.GetCount(sizeof(uint16_t)); left > 0; --left) {
    const ObjectId id(in.Get<uint16_t>());
    const auto generation = in.Get<uint32_t>();
    std::vector<SurfaceSite> sites;
    if (absl::Status s = ReadSites(in.GetText(), &sites); !s.ok()) return s;
    map->shapes_[{id, generation}] = BuildObjectShape(std::move(sites), config.voxel_size_m);
  }
  const bool observed = in.Get<uint8_t>() != 0;
  Eigen::AlignedBox<int32_t, 3> box;
  in.GetMatrix(box.min());
  in.GetMatrix(box.max());
  if (observed) map->observed_blocks_ = box;
  if (absl::Status s = in.Finish(); !s.ok()) return s;
  return map;
}

}  // namespace clearance
