// What one map computes, as the mapping thread sees it: the engine runs it and knows nothing of
// how.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
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
};

using MapModelFactory = std::function<std::unique_ptr<MapModel>(const MapConfig&)>;

}  // namespace clearance
