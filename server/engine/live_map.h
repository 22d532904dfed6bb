// The map that the server runs: Alg. 1, Apply, distance field and object shapes, one after the
// other.
#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "server/engine/map_model.h"
#include "server/esdf/field_updater.h"
#include "server/integration/frame_integrator.h"
#include "server/query/block_mesher.h"

namespace clearance {

class LiveMap final : public MapModel {
 public:
  explicit LiveMap(const MapConfig& config, StageClock clock = WallMs);

  absl::StatusOr<Integrated> Integrate(const Frame& frame) override;
  absl::StatusOr<Edited> Edit(const RegionEdit& edit) override;
  MapView View() override;
  MapSizes Sizes() override;
  absl::StatusOr<Surface> FindSurface(ObjectId id, uint32_t generation) override;
  absl::StatusOr<Mesh> ExtractMesh(ObjectId id, uint32_t generation) override;

  uint64_t revision() const override { return world_.revision(); }
  std::optional<Eviction> ChooseEviction(double keep) override;
  void Evict(const Eviction& eviction) override;
  std::unique_ptr<FrozenModel> Freeze() override;
  static absl::StatusOr<std::unique_ptr<MapModel>> Load(const MapConfig& config,
                                                        const FileSource& files);

  const WorldMap& world() const { return world_; }

 private:
  using SurfaceKey = std::pair<ObjectId, uint32_t>;  // and generation; (0, 0) is the static map

  void UpdateField(const AppliedChanges& changes);
  void UpdateShapes(const AppliedChanges& changes);
  void MarkMeshes(const AppliedChanges& changes);
  void ForgetEvicted();
  ObjectView ViewOf(const ObjectSubmap& object, int64_t stamp_ns) const;

  const MapConfig config_;
  const StageClock clock_;
  const FrameIntegrator integrator_;
  WorldMap world_;
  FieldUpdater updater_;
  DistanceField field_;
  // Shared by every view until the object's surface changes.
  std::map<SurfaceKey, std::shared_ptr<const ObjectShape>> shapes_;
  // Of surfaces that were exported before: the next export meshes only what changed since.
  std::map<SurfaceKey, BlockMesher> meshers_;
  std::optional<Eigen::AlignedBox<int32_t, 3>> observed_blocks_;
};

// Makes LiveMaps: the registry's default.
MapModelFactory LiveMapFactory();
MapModelLoader LiveMapLoader();

}  // namespace clearance
