// What one map computes, as the mapping thread sees it: the engine runs it and knows nothing of
// how.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "server/core/frame.h"
#include "server/core/stage_laps.h"
#include "server/map/map_view.h"
#include "server/map/world_map.h"
#include "server/query/mesh.h"

namespace clearance {

// Sizes for people and metrics; taken now and then, not for every revision.
struct MapSizes {
  uint64_t memory_bytes = 0;
  uint64_t static_voxels = 0;  // that hold surface
  uint64_t field_blocks = 0;
  std::optional<Aabb> observed_W;  // what was observed, free space included
};

// The files of a snapshot, one by one, and their content by name.
using FileSink = std::function<absl::Status(std::string_view name, std::string bytes)>;
using FileSource = std::function<absl::StatusOr<std::string>(std::string_view name)>;

// A map's state at one revision, to be written elsewhere while the map goes on. Any thread.
class FrozenModel {
 public:
  virtual ~FrozenModel() = default;
  // Stops at the first error of `sink`.
  virtual absl::Status Write(const FileSink& sink) const = 0;
};

// Not thread-safe: every call comes from the mapping thread.
class MapModel {
 public:
  virtual ~MapModel() = default;

  struct Integrated {
    std::vector<Violation> violations;  // refused object motions; the frame counts
    StageTimes stages;  // "integrate" is the sum of the integrator's own
  };
  // Integrates and applies one frame; the next View shows it. INVALID_ARGUMENT: nothing changed.
  virtual absl::StatusOr<Integrated> Integrate(const Frame& frame) = 0;

  struct Edited {
    uint64_t changed_voxels = 0;
  };
  virtual absl::StatusOr<Edited> Edit(const RegionEdit& edit) = 0;

  // A surface for exports: the static map's (id 0) or an object's, newest generation where 0. Valid
  // until the next call that changes the map. NOT_FOUND naming the objects that exist.
  struct Surface {
    const SurfaceMap* map = nullptr;
    Pose T_W_L = Pose::Identity();  // now
    ObjectId id;
    uint32_t generation = 0;
  };
  virtual absl::StatusOr<Surface> FindSurface(ObjectId id, uint32_t generation) = 0;

  // The surface's mesh in its own frame (W or L); NOT_FOUND as FindSurface.
  virtual absl::StatusOr<Mesh> ExtractMesh(ObjectId id, uint32_t generation) = 0;

  // The state now. The engine fills in epoch and published_at.
  virtual MapView View() = 0;
  virtual MapSizes Sizes() = 0;

  // Counts integrated frames, edits and evictions.
  virtual uint64_t revision() const = 0;

  // Static surface and free space whose blocks are farther than `radius_m` from `centre_W`: where
  // to cut so that about `keep` (0 to 1) of the blocks stay, around the newest sensor pose, and
  // the cut itself. Absent where there is nothing to cut.
  struct Eviction {
    Eigen::Vector3d centre_W = Eigen::Vector3d::Zero();
    double radius_m = 0;
  };
  virtual std::optional<Eviction> ChooseEviction(double keep) = 0;
  virtual void Evict(const Eviction& eviction) = 0;

  // The whole state, for a snapshot.
  virtual std::unique_ptr<FrozenModel> Freeze() = 0;
};

using MapModelFactory = std::function<std::unique_ptr<MapModel>(const MapConfig&)>;
// A model that goes on exactly where the frozen one stood. DATA_LOSS for files of another kind.
using MapModelLoader =
    std::function<absl::StatusOr<std::unique_ptr<MapModel>>(const MapConfig&, const FileSource&)>;

}  // namespace clearance
