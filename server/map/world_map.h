// The mapping side of one map: the static surface and every object, before publication.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/map/map_config.h"
#include "server/map/map_update.h"
#include "server/map/object_submap.h"
#include "server/map/surface_map.h"

namespace clearance {

// What one Apply changed; the field, the shapes and the meshes follow it.
struct AppliedChanges {
  std::vector<BlockIndex> static_blocks;  // sorted
  struct Object {
    ObjectId id;
    std::vector<BlockIndex> blocks;  // of L, sorted
    bool new_generation = false;
  };
  std::vector<Object> objects;  // by id
};

// A region edit: clear to unknown, mark free, mark occupied. Exactly one of box and sphere.
struct RegionEdit {
  RegionAction action = RegionAction::kClearToUnknown;
  std::optional<Aabb> box;  // W
  std::optional<Eigen::Vector3d> sphere_centre;
  double sphere_radius_m = 0;
};

inline constexpr size_t kMaxRetiredObjects = 256;  // older ones are evicted
inline constexpr size_t kMaxSensorPoses = 4096;

// R^0 and all R^j. Mutated only by Apply and Edit, on the mapping thread; no readers meanwhile.
class WorldMap {
 public:
  explicit WorldMap(const MapConfig& config);

  const MapConfig& config() const { return config_; }
  const FusionOptions& fusion() const { return fusion_; }
  const SurfaceMap& static_map() const { return static_map_; }
  const std::map<ObjectId, ObjectSubmap>& objects() const { return objects_; }
  // Earlier generations that are retired but still listed and exportable, oldest first.
  const std::vector<ObjectSubmap>& retired() const { return retired_; }
  int64_t stamp_ns() const { return stamp_ns_; }
  // Newest frame id of a source, absent before its first frame; a motion without from_frame_id
  // starts there.
  std::optional<uint64_t> last_frame_id(const std::string& source_id) const;
  uint64_t revision() const { return revision_; }
  const std::vector<PoseStamp>& sensor_path() const { return sensor_path_; }

  AppliedChanges Apply(const MapUpdate& update);
  AppliedChanges Edit(const RegionEdit& edit);
  // Forgets the static map's blocks farther than `radius_m` from `centre_W`; returns them.
  std::vector<BlockIndex> Evict(const Eigen::Vector3d& centre_W, double radius_m);

  uint64_t MemoryBytes() const;

  // For snapshots: everything but the surfaces, and a world that goes on exactly as the saved one.
  // `surface(id, generation)` gives each surface, (0, 0) the static one. DATA_LOSS for bytes that
  // Save did not write.
  void Save(ByteWriter* out) const;
  using SurfaceSource = std::function<absl::StatusOr<SurfaceMap>(ObjectId, uint32_t)>;
  static absl::StatusOr<WorldMap> Load(const MapConfig& config, ByteReader* in,
                                       const SurfaceSource& surface);

 private:
  void Retire(ObjectSubmap& object);

  MapConfig config_;
  FusionOptions fusion_;
  SurfaceMap static_map_;
  std::map<ObjectId, ObjectSubmap> objects_;
  std::vector<ObjectSubmap> retired_;
  std::map<std::string, uint64_t> last_frame_ids_;
  std::vector<PoseStamp> sensor_path_;
  int64_t stamp_ns_ = 0;
  uint64_t revision_ = 0;
};

}  // namespace clearance
