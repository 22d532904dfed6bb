#include "server/engine/live_map.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/esdf/site_extraction.h"
#include "server/map/eviction.h"
#include "server/map/surface_grids.h"
#include "server/query/object_index.h"
#include "server/query/site_following.h"

namespace clearance {
namespace {

bool Contains(const RegionEdit& edit, const Eigen::Vector3d& p_W) {
  if (edit.box) return edit.box->contains(p_W);
  return (p_W - *edit.sphere_centre).norm() <= edit.sphere_radius_m;
}

}  // namespace

LiveMap::LiveMap(const MapConfig& config, StageClock clock)
    : config_(config),
      clock_(clock),
      integrator_(IntegratorOptions::For(config)),
      world_(config),
      updater_(config, world_.fusion()),
      field_(config.voxel_size_m, config.max_distance_m) {}

absl::StatusOr<MapModel::Integrated> LiveMap::Integrate(const Frame& frame) {
  Integrated result;
  StageLaps laps(&result.stages, clock_);
  absl::StatusOr<MapUpdate> update = integrator_.Integrate(frame, world_, laps);
  if (!update.ok()) return update.status();
  laps.Whole("integrate");
  const AppliedChanges changes = world_.Apply(*update);
  laps.Lap("apply");
  UpdateField(changes);
  laps.Lap("field");
  UpdateShapes(changes);
  laps.Lap("shapes");
  result.violations = std::move(update->violations);
  return result;
}

absl::StatusOr<MapModel::Edited> LiveMap::Edit(const RegionEdit& edit) {
  const AppliedChanges changes = world_.Edit(edit);
  UpdateField(changes);
  UpdateShapes(changes);
  Edited edited;
  for (const BlockIndex& block : changes.static_blocks) {
    for (int offset = 0; offset < kBlockVoxels; ++offset) {
      const VoxelIndex voxel = VoxelAt(block, offset);
      edited.changed_voxels += Contains(edit, VoxelCentre(voxel, config_.voxel_size_m));
    }
  }
  return edited;
}

std::optional<MapModel::Eviction> LiveMap::ChooseEviction(double keep) {
  if (world_.sensor_path().empty()) return std::nullopt;
  Eviction eviction;
  eviction.centre_W = world_.sensor_path().back().pose.translation();
  const auto radius_m = EvictionRadius(world_.static_map(), eviction.centre_W, keep);
  if (!radius_m) return std::nullopt;
  eviction.radius_m = *radius_m;
  return eviction;
}

void LiveMap::Evict(const Eviction& eviction) {
  AppliedChanges changes;
  changes.static_blocks = world_.Evict(eviction.centre_W, eviction.radius_m);
  UpdateField(changes);
  MarkMeshes(changes);
  updater_.ReleaseSpare();
}

void LiveMap::UpdateField(const AppliedChanges& changes) {
  field_ = updater_.Update(world_.static_map(), changes.static_blocks);
  for (const BlockIndex& block : changes.static_blocks) {
    const Eigen::Matrix<int32_t, 3, 1> index(block.x, block.y, block.z);
    if (observed_blocks_) {
      observed_blocks_->extend(index);
    } else {
      observed_blocks_.emplace(index);
    }
  }
}

void LiveMap::UpdateShapes(const AppliedChanges& changes) {
  for (const AppliedChanges::Object& changed : changes.objects) {
    const auto it = world_.objects().find(changed.id);
    if (it == world_.objects().end()) continue;
    const ObjectSubmap& object = it->second;
    std::shared_ptr<const ObjectShape>& shape = shapes_[{object.id(), object.generation()}];
    if (shape && changed.blocks.empty()) continue;
    shape = FollowSites(shape, ExtractSurfaceSites(object.surface(), world_.fusion()),
                        config_.voxel_size_m);
  }
  MarkMeshes(changes);
  if (shapes_.size() > world_.objects().size() + world_.retired().size()) ForgetEvicted();
}

void LiveMap::MarkMeshes(const AppliedChanges& changes) {
  if (meshers_.empty()) return;
  const auto mark = [this](const SurfaceKey& key, const std::vector<BlockIndex>& blocks) {
    if (const auto it = meshers_.find(key); it != meshers_.end()) it->second.MarkChanged(blocks);
  };
  mark({kStaticWorld, 0}, changes.static_blocks);
  for (const AppliedChanges::Object& changed : changes.objects) {
    const auto it = world_.objects().find(changed.id);
    if (it != world_.objects().end()) mark({changed.id, it->second.generation()}, changed.blocks);
  }
}

void LiveMap::ForgetEvicted() {
  std::set<SurfaceKey> known = {{kStaticWorld, 0}};
  for (const ObjectSubmap& object : world_.retired())
    known.emplace(object.id(), object.generation());
  for (const auto& [id, object] : world_.objects()) known.emplace(id, object.generation());
  const auto evicted = [&known](const auto& entry) { return !known.contains(entry.first); };
  std::erase_if(shapes_, evicted);
  std::erase_if(meshers_, evicted);
}

ObjectView LiveMap::ViewOf(const ObjectSubmap& object, int64_t stamp_ns) const {
  ObjectView view = object.View(stamp_ns);
  const auto shape = shapes_.find({object.id(), object.generation()});
  if (shape != shapes_.end()) view.shape = shape->second;
  return view;
}

MapView LiveMap::View() {
  MapView view;
  view.config = config_;
  view.revision = world_.revision();
  view.field_revision = world_.revision();
  view.stamp_ns = world_.stamp_ns();
  view.field = field_;
  for (const ObjectSubmap& object : world_.retired()) {
    view.objects.push_back(ViewOf(object, view.stamp_ns));
  }
  for (const auto& [id, object] : world_.objects()) {
    view.objects.push_back(ViewOf(object, view.stamp_ns));
  }
  std::sort(view.objects.begin(), view.objects.end(), [](const ObjectView& a, const ObjectView& b) {
    return std::pair(a.id, a.generation) < std::pair(b.id, b.generation);
  });
  view.object_index = BuildObjectIndex(view.objects);
  view.sensor_path = std::make_shared<const std::vector<PoseStamp>>(world_.sensor_path());
  return view;
}

MapSizes LiveMap::Sizes() {
  MapSizes sizes;
  sizes.memory_bytes = world_.MemoryBytes() + updater_.MemoryBytes() + field_.MemoryBytes();
  sizes.static_voxels = world_.static_map().grids().weight->activeVoxelCount();
  sizes.field_blocks = field_.BlockCount();
  if (observed_blocks_) {
    const double side_m = kBlockSide * config_.voxel_size_m;
    sizes.observed_W = Aabb(observed_blocks_->min().cast<double>() * side_m,
                            (observed_blocks_->max().cast<double>().array() + 1.0) * side_m);
  }
  return sizes;
}

absl::StatusOr<MapModel::Surface> LiveMap::FindSurface(ObjectId id, uint32_t generation) {
  if (id.is_static()) return Surface{&world_.static_map(), Pose::Identity(), id, 0};
  const ObjectSubmap* found = nullptr;
  const auto consider = [&](const ObjectSubmap& object) {
    if (object.id() != id || (generation != 0 && object.generation() != generation)) return;
    if (found == nullptr || object.generation() > found->generation()) found = &object;
  };
  for (const ObjectSubmap& object : world_.retired()) consider(object);
  for (const auto& [live_id, object] : world_.objects()) consider(object);
  if (found != nullptr) {
    return Surface{&found->surface(), ViewOf(*found, world_.stamp_ns()).T_W_L, id,
                   found->generation()};
  }
  const std::string existing =
      absl::StrJoin(world_.objects(), ", ", [](std::string* out, const auto& entry) {
        out->append(std::to_string(entry.first.value()));
      });
  return absl::NotFoundError(
      absl::StrFormat("object %d%s does not exist. Objects: %s", id.value(),
                      generation == 0 ? "" : absl::StrFormat(" of generation %d", generation),
                      existing.empty() ? "none" : existing));
}

absl::StatusOr<Mesh> LiveMap::ExtractMesh(ObjectId id, uint32_t generation) {
  const absl::StatusOr<Surface> surface = FindSurface(id, generation);
  if (!surface.ok()) return surface.status();
  MesherOptions options;
  options.min_weight = world_.fusion().min_weight;
  const auto [it, fresh] = meshers_.try_emplace({id, surface->generation}, options);
  if (fresh) it->second.MarkAll(*surface->map);
  return it->second.Extract(*surface->map);
}

MapModelFactory LiveMapFactory() {
  return [](const MapConfig& config) { return std::make_unique<LiveMap>(config); };
}

MapModelLoader LiveMapLoader() { return LiveMap::Load; }

}  // namespace clearance
